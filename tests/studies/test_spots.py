"""Spots in miniature: learnt, told apart, stable, and recalled from beside them."""

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.baselines.generic import unit_rows
from elfslam.world.room import standing_room
from elfslam.world.world_file import load_world
from studies import displacement, distinctness, spots, stability
from studies.displacement import MOVED_M, RECALL, recall
from studies.distinctness import CHIRP, MEAN_M, RECOGNISED, SPOTS_SHOWN, TONE, TSNE_1, TSNE_2
from studies.plain_features import PLAIN, compared_encoders
from studies.results import Record
from studies.stability import AGE, ELSEWHERE, HEIGHT, LEVEL, PLACE, WHOLE, YAW, compared
from studies.study import StudyContext


@pytest.mark.parametrize("spacing_m", [0.25, 1.0, 3.0])
def test_neighbours_are_as_far_apart_as_asked_and_where_one_can_stand(spacing_m: float) -> None:
    room = load_world("lab").room
    found = spots.spots_apart(room, spacing_m, 16, np.random.default_rng(0))
    assert found.shape == (16, 2)
    assert standing_room(room, found).all()
    apart_m = np.linalg.norm(found[:, None] - found, axis=2)[np.triu_indices(16, 1)]
    assert apart_m.min() == pytest.approx(spacing_m)
    other = spots.spots_apart(room, spacing_m, 16, np.random.default_rng(1))
    assert not np.array_equal(found, other)


def test_a_room_too_small_for_the_spots_is_refused() -> None:
    with pytest.raises(InputError, match="wanted 16 free places 9 m apart; ask for fewer"):
        spots.spots_apart(load_world("lab").room, 9.0, 16, np.random.default_rng(0))


def test_spots_are_recognised_that_were_learnt() -> None:
    recipe = spots.Recipe(learnt=20, queried=5, batch=20, fewest_steps=40)
    records = spots.measure_repeat(spots.Repeat(spots.Point(spots.COUNT, 2, 1), 0, recipe))
    found = {(each.method, each.metric): each.value for each in records}
    assert found["same visit", spots.RECOGNISED] > 0.8
    assert found["same visit", spots.MEAN_M] < found[spots.GUESS, spots.MEAN_M]


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return distinctness.measure_distinctness(StudyContext(), spots=10)


def test_a_chirp_tells_spots_apart_better_than_a_tone(records: list[Record]) -> None:
    found = {(each.method, each.metric): each.value for each in records}
    assert found[CHIRP, RECOGNISED] > found[TONE, RECOGNISED]
    assert found[CHIRP, MEAN_M] <= found[TONE, MEAN_M]


def test_echoes_of_a_chirp_lie_nearest_to_their_own_spots_cloud(records: list[Record]) -> None:
    axes = {
        metric: np.array([r.value for r in records if (r.method, r.metric) == (CHIRP, metric)])
        for metric in (TSNE_1, TSNE_2)
    }
    plane = np.column_stack(list(axes.values())).reshape(SPOTS_SHOWN, distinctness.ECHOES, 2)
    middles = plane.mean(axis=1)
    nearest = np.linalg.norm(plane[:, :, None] - middles, axis=3).argmin(axis=2)
    assert (nearest == np.arange(SPOTS_SHOWN)[:, None]).mean() > 0.95


SPECTRA_DB = np.random.default_rng(0).normal(-40, 3, (5, 71))


def test_a_louder_spectrum_correlates_all_the_same() -> None:
    found = compared(SPECTRA_DB, SPECTRA_DB + 3.0)
    np.testing.assert_allclose(found[WHOLE], 1.0)
    np.testing.assert_allclose(found[PLACE], 1.0)
    np.testing.assert_allclose(found[LEVEL], 3.0)


def test_what_all_spots_share_is_the_phones() -> None:
    phone = 20 * np.sin(np.linspace(0, 3, 71))
    elsewhere = stability.compared_elsewhere(SPECTRA_DB + phone)
    assert elsewhere[WHOLE].min() > 0.5
    assert elsewhere[PLACE].max() < 0.1
    assert elsewhere[LEVEL].shape == (5,)


def test_a_spot_is_itself_again_and_not_another() -> None:
    records = stability.measure_stability(StudyContext(), spots=6)
    means = {(each.condition, each.metric): each.value for each in records}
    for first in (f"100 {HEIGHT}", f"0 {YAW}", f"0 {AGE}"):
        for metric in (WHOLE, PLACE):
            assert means[first, metric] > means[ELSEWHERE, metric] + 0.005
        assert means[first, LEVEL] < means[ELSEWHERE, LEVEL]
    assert means[f"180 {YAW}", PLACE] < means[f"10 {YAW}", PLACE]
    assert means[f"30 {AGE}", PLACE] > means[f"180 {YAW}", PLACE]
    spectrum = [each for each in records if each.method == f"40 {YAW}"]
    assert (spectrum[0].condition, spectrum[-1].condition) == ("15 kHz", "20.25 kHz")


@pytest.fixture(scope="module")
def found() -> list[Record]:
    mine = {"mine": compared_encoders()[PLAIN]}
    study = displacement.STUDY
    return list(study.measure(StudyContext(), encoders=mine, **study.fast))


def curve(found: list[Record], method: str) -> list[float]:
    chosen = [each for each in found if (each.metric, each.method) == (RECALL, method)]
    assert [each.condition for each in chosen] == [f"{100 * far:g} cm" for far in MOVED_M]
    return [each.value for each in chosen]


def test_the_elf_knows_a_place_from_a_decimetre_away(found: list[Record]) -> None:
    elf, plain = (curve(found, name) for name in ("ELF", PLAIN))
    assert elf[4] > 0.8 > plain[4]
    assert elf[8] < 0.5
    assert curve(found, "mine") == plain, "the same feature under a name of its own"


def test_recall_counts_what_is_more_similar_than_others() -> None:
    generator = np.random.default_rng(4)
    here = unit_rows(generator.standard_normal((200, 64)).astype(np.float32))
    other = ~np.eye(200, dtype=bool)
    moved = here.copy()
    moved[:50] = here[::-1][:50]
    assert recall(here, moved, other) == pytest.approx(0.75)
