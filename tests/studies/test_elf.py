"""The study of known places: planted pairs, diagonals, and one short walk."""

from pathlib import Path

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from elfslam.app.card import ON_THE_CARD, metrics_of
from elfslam.base.errors import InputError
from elfslam.base.values import Odometry, Truth
from elfslam.baselines.generic import generic_encoders
from elfslam.stages.feature import load_encoder
from studies import elf as study
from studies.results import Record, stamped, write_results
from studies.study import StudyContext

CIRCLE_M = 4.0


def circle(rounds: int, *, back: bool = False) -> tuple[Odometry, Truth]:
    """Rounds of 24 footsteps each on a circle; `back` turns after the first half of them."""
    t_s = np.linspace(0, 24.0 * rounds, 24 * rounds * 10 + 1)
    angle = 2 * np.pi * t_s / 24.0
    sense = np.ones_like(t_s)
    if back:
        sense[angle > np.pi * rounds] = -1
        angle = np.where(sense > 0, angle, 2 * np.pi * rounds - angle)
    xy_m = CIRCLE_M * np.column_stack([np.cos(angle), np.sin(angle)])
    truth = Truth(t_s, np.column_stack([xy_m, angle + sense * np.pi / 2]))
    steps_s = np.arange(24.0 * rounds + 1)
    nodes = Odometry(steps_s, np.zeros((len(steps_s), 3)), np.full((len(steps_s) - 1, 3), 0.05))
    return nodes, truth


def test_the_same_place_of_every_round_is_found_once() -> None:
    same, elsewhere = study.labelled_pairs(*circle(3), rounds=3)
    i, j = np.nonzero(same)
    assert len(i) == 24 * 3, "each of 24 places, in three pairs of rounds"
    assert set(j - i) == {24, 48}
    assert not (same & elsewhere).any()
    assert not elsewhere[np.tril_indices(72)].any()
    first_with_second = elsewhere[:24, 24:48]
    assert not np.diag(first_with_second, -13)[:3].any(), "less than half a lap apart"
    assert first_with_second[3, 10]


def test_the_other_way_round_is_no_same_place() -> None:
    same, elsewhere = study.labelled_pairs(*circle(2, back=True), rounds=2)
    assert not same.any()
    assert elsewhere.any()


def test_a_diagonal_is_averaged_about_its_middle() -> None:
    scores = np.zeros((30, 30), dtype=np.float32)
    for k in range(8):
        scores[6 + k, 16 + k] = 1.0
        scores[6 + k, 29 - k] = 0.5
    made = study.sequence_similarity(scores)
    assert made[10, 20] == pytest.approx(1.0)
    assert made[10, 25] == pytest.approx(0.5), "the second walked the other way round"
    assert np.isnan(made[3, 10])
    assert np.isnan(made[10, 27])
    assert np.nanmin(made) == 0.0


@pytest.fixture(scope="module")
def found() -> list[Record]:
    encoders = {"PSD": generic_encoders()["PSD"], "ELF": load_encoder("compact")}
    how = {"worlds": ("studio",), "seeds": (100,), "rounds": 3}
    return study.measure_elf(StudyContext(), encoders=encoders, **how)


def test_an_elf_knows_a_place_better_than_its_spectrum(found: list[Record]) -> None:
    value = {(each.method, each.condition, each.metric): each.value for each in found}
    psd, elf = (value[method, "1 footstep", "AUC"] for method in ("PSD", "ELF"))
    assert elf > 0.97 > psd
    assert value["ELF", "8 footsteps", "AUC"] >= elf


def test_what_the_study_gives_fits_on_a_card(found: list[Record], tmp_path: Path) -> None:
    of_one = [each for each in found if each.method == "ELF"]
    write_results(tmp_path / "elf.csv", stamped("elf", of_one, "12345678", "2026-11-28"))
    on_card = metrics_of(tmp_path / "elf.csv")
    assert len(on_card) == 2 * len(ON_THE_CARD)
    (wanted,) = (e for e in of_one if (e.metric, e.condition) == ("AUC", "1 footstep"))
    assert on_card["AUC, 1 footstep, studio"] == pytest.approx(wanted.value, rel=1e-5)


OF = Record("ELF", "", 0.0, world="studio")


def drawn_pairs(seed: int = 0, same: int = 400, elsewhere: int = 5000) -> tuple:
    generator = np.random.default_rng(seed)
    return generator.normal(0.5, 0.15, same), generator.normal(0.1, 0.15, elsewhere)


def test_the_area_is_that_of_scikit_learn() -> None:
    same, elsewhere = drawn_pairs()
    truth = np.repeat([1, 0], [len(same), len(elsewhere)])
    expected = roc_auc_score(truth, np.concatenate([same, elsewhere]))
    area = study.area_under_curve(study.histograms(same, elsewhere))
    assert area == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("rate", [0.01, 0.001])
def test_recall_is_that_of_the_sorted_values(rate: float) -> None:
    same, elsewhere = drawn_pairs()
    allowed = int(rate * len(elsewhere))
    threshold = np.sort(elsewhere)[-allowed - 1]
    got = study.recall_at(study.histograms(same, elsewhere), rate)
    assert got == pytest.approx(np.mean(same > threshold), abs=0.01)


def test_one_feature_for_all_places_recalls_nothing() -> None:
    counts = study.histograms(np.full(10, 0.9), np.full(100, 0.9))
    assert study.area_under_curve(counts) == pytest.approx(0.5)
    assert study.recall_at(counts, 0.01) == 0.0


def test_walks_are_pooled_and_the_threshold_is_read() -> None:
    walks = [
        study.histograms(np.array([0.5, 0.39]), np.array([0.0, 0.0, 0.4, 0.2])),
        study.histograms(np.array([0.41, 0.7]), np.array([0.1, 0.1, 0.1, 0.1])),
    ]
    found = {each.metric: each for each in study.separation_records(walks, 0.4, OF)}
    assert found["recall at 0.4"].value == 0.75
    assert found["false positives at 0.4"].value == 0.125
    recall = found["recall at 1 % false positives"]
    assert (recall.value, recall.low, recall.high, recall.world) == (0.75, 0.5, 1.0, "studio")


def test_walks_that_never_return_are_left_out_and_refused_alone() -> None:
    empty = study.histograms(np.array([]), np.array([0.1]))
    whole = study.histograms(np.array([0.9]), np.array([0.1]))
    both, alone = (study.separation_records(of, 0.4, OF) for of in ([empty, whole], [whole]))
    assert both == alone
    with pytest.raises(InputError, match="no walk comes back to a place"):
        study.separation_records([empty], 0.4, OF)
