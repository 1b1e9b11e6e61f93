"""Laps of people, in small: planted features are found or not, and more laps are a longer list."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.baselines.generic import generic_encoders
from elfslam.world.kinds import PEOPLE, QUIET
from elfslam.world.world_file import load_world
from studies import lap_echoes
from studies import laps as study
from studies.located import MEDIAN_M, OVER_1_M
from studies.plain_features import ChanceEncoder
from studies.results import Record
from studies.study import StudyContext

SPECTROGRAM = generic_encoders()["spectrogram without mean"]
VENUE = ("studio", QUIET.name)


@dataclass(frozen=True)
class Deaf:
    """An encoder to which all places sound the same."""

    identity: str = "deaf"
    still: float = 1.0
    successive: float = 0.0

    def embed(self, samples: F32) -> F32:
        return np.tile(np.eye(1, 4, dtype=np.float32), (len(samples), 1))


def ring(angles: F64, radius_m: float = 5.0, heading_rad: float = 0.0) -> lap_echoes.Places:
    """Places on a circle that sound as they lie: the feature is the true position."""
    unit = np.column_stack([np.cos(angles), np.sin(angles)])
    headings = np.full(len(angles), heading_rad)
    return lap_echoes.Places(unit.astype(np.float32), radius_m * unit, headings)


def evenly(count: int) -> F64:
    return np.linspace(0.0, 2 * np.pi, count, endpoint=False)


def scattered(count: int, generator: np.random.Generator) -> lap_echoes.Places:
    vectors, xy_m = (generator.standard_normal((count, size)) for size in (4, 2))
    return lap_echoes.Places(vectors.astype(np.float32), xy_m, np.zeros(count))


def test_a_feature_that_is_the_true_position_finds_it() -> None:
    angles = evenly(40)
    found = study.answers_by(ring(angles[::-3]), ring(angles))
    np.testing.assert_allclose(found.error_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.likeness, 1.0, atol=1e-6)
    between = study.answers_by(ring(angles + 0.02), ring(angles))
    np.testing.assert_allclose(between.error_m, 2 * 5.0 * np.sin(0.01), rtol=1e-6)


def test_a_feature_that_is_the_same_everywhere_is_at_chance() -> None:
    """The first spot is as good as any: on a circle the median distance of two is sqrt(2) r."""
    angles = evenly(400)
    same = np.ones((400, 3), dtype=np.float32)
    places = lap_echoes.Places(same, ring(angles).xy_m, np.zeros(400))
    numbers = study.numbers_of(study.answers_by(places, places))
    assert numbers[MEDIAN_M] == pytest.approx(np.sqrt(2) * 5.0, rel=0.02)
    assert numbers[OVER_1_M] == pytest.approx(1 - 2 * np.arcsin(0.1) / np.pi, abs=0.01)


def test_more_laps_are_the_best_of_their_answers() -> None:
    generator = np.random.default_rng(0)
    asked, *laps = (scattered(count, generator) for count in (30, 20, 20, 20, 20, 20))
    each = [study.answers_by(asked, lap) for lap in laps]
    for count in (1, 2, 5):
        together = study.answers_by(asked, lap_echoes.joined(laps[:count]))
        for one, other in zip(study.best_answers(each[:count]), together, strict=True):
            np.testing.assert_array_equal(one, other)
    more, fewer = study.best_answers(each), study.best_answers(each[:2])
    assert (more.likeness >= fewer.likeness).all()


def test_what_is_found_beside_a_lane_is_counted_by_its_offset() -> None:
    angles = evenly(2000)
    lap, near, far = ring(angles), ring(angles[::40], 5.1), ring(angles[::40], 5.3)
    alike = study.recalls([study.beside(near, lap)])
    assert (alike["near 0.15"], alike["found 0.15"]) == (50, 50)
    assert alike["near 0.4"] == alike["near 0.8"] == 0
    deaf = lap_echoes.Places(np.ones_like(far.vectors), far.xy_m, far.heading_rad)
    same = lap_echoes.Places(np.ones_like(lap.vectors), lap.xy_m, lap.heading_rad)
    assert study.recalls([study.beside(deaf, same)]) == {
        "near 0.15": 0, "found 0.15": 0, "near 0.4": 50, "found 0.4": 0, "near 0.8": 0,
        "found 0.8": 0,
    }  # fmt: skip


def test_a_spot_passed_the_other_way_is_not_beside() -> None:
    angles = evenly(200)
    opposite = study.beside(ring(angles), ring(angles, heading_rad=np.pi))
    assert np.isinf(opposite.offset_m).all()
    both = study.recalls([opposite, study.beside(ring(angles), ring(angles, 5.2))])
    assert (both["near 0.15"], both["near 0.4"]) == (0, 200)


def test_laps_go_both_ways_and_every_one_is_anothers() -> None:
    venue = lap_echoes.venue_of(*VENUE)
    laps = [lap_echoes.mapped_lap(venue, 0.3, 100, number) for number in range(3)]
    strange = lap_echoes.strange_laps(venue, 0.3, 100)
    around = [_area_m2(lap.xy_m) for lap in (*laps, *strange)]
    assert np.sign(around).tolist() in ([1, -1, 1, 1, -1], [-1, 1, -1, -1, 1])
    assert len({lap.samples.tobytes() for lap in (*laps, *strange)}) == 5
    again = lap_echoes.mapped_lap(venue, 0.3, 100, 1)
    assert again.samples.tobytes() == laps[1].samples.tobytes()
    assert again.xy_m.tobytes() == laps[1].xy_m.tobytes()


def _area_m2(xy_m: F64) -> float:
    """Twice the area that a way goes round, negative where clockwise."""
    x, y = xy_m.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_who_stands_is_not_heard() -> None:
    lap = lap_echoes.mapped_lap(lap_echoes.venue_of(*VENUE), 0.3, 100, 0)
    on_the_move = np.diff(lap.t_s) < 0.11
    far_m = np.linalg.norm(lap.xy_m[6:] - lap.xy_m[:-6], axis=1)
    whole = np.array([on_the_move[k : k + 6].all() for k in range(len(far_m))])
    assert whole.sum() > 100
    assert far_m[whole].min() > 0.8 * lap_echoes.MOVED_M
    assert lap.t_s[0] > 0.5, "standing before the lap is left out"


def test_echoes_tell_places_and_the_deaf_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "own_lane_m", lambda world: 0.1)
    few = {**study.STUDY.fast, "laps": (), "lap_seeds": ()}
    records = study.measure_laps(StudyContext(), encoders={"deaf": Deaf()}, kind=QUIET, **few)
    found = {(each.method, each.condition, each.metric): each.value for each in records}
    lanes, recall = "0.1 m lanes", "recall at 1 %, 0 to 0.15 m"
    assert found["ELF", lanes, MEDIAN_M] < 0.5
    assert found["deaf", lanes, MEDIAN_M] > 1.5
    assert found["ELF", lanes, recall] > 0.5
    assert found["deaf", lanes, recall] == 0.0


def test_recall_is_of_all_places_of_all_seeds() -> None:
    """Three of four and one of sixteen: of all twenty a fifth was found."""
    tasks = [lap_echoes.Crowd(*VENUE, 0.3, seed, (study.FEW,)) for seed in (0, 1)]
    counts = ((4.0, 3.0), (16.0, 1.0))
    walks = [
        [Record("ELF", f"{what} 0.15", value, condition=study.condition_of(task, study.FEW))
         for what, value in zip(("near", "found"), count, strict=True)]
        for task, count in zip(tasks, counts, strict=True)
    ]  # fmt: skip
    (record,) = study._means(tasks, walks)
    assert (record.metric, record.seeds) == ("recall at 1 %, 0 to 0.15 m", "0 to 1")
    assert record.value == pytest.approx(0.2)


@pytest.mark.parametrize("asked_by", lap_echoes.CHANGES)
def test_who_asks_changes_what_is_said_and_nothing_else(asked_by: str) -> None:
    room = load_world("studio").room
    mapped, later = PEOPLE.mapping(room), PEOPLE.asking(room)
    asking = lap_echoes._asking(PEOPLE, room, asked_by)
    assert (asking.device == later.device) == ("phone" in asked_by)
    assert (asking.day == later.day) == ("day" in asked_by)
    assert replace(asking, device=mapped.device, day=mapped.day) == mapped
    assert mapped.device != later.device
    assert mapped.day != later.day


def test_chance_is_a_spot_at_random() -> None:
    angles = evenly(300)
    noise = np.random.default_rng(0).standard_normal((600, 2352)).astype(np.float32)
    rows = ChanceEncoder().embed(noise)
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1.0, rtol=1e-6)
    np.testing.assert_array_equal(ChanceEncoder().embed(noise[5:6])[0], rows[5])
    asked, spots = (replace(ring(angles), vectors=part) for part in (rows[:300], rows[300:]))
    median_m = np.median(study.answers_by(asked, spots).error_m)
    assert median_m == pytest.approx(np.sqrt(2) * 5.0, rel=0.1)
