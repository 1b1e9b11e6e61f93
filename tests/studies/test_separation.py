"""Same place or elsewhere: histograms against the values themselves."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from elfslam.base.errors import InputError
from studies.elf import area_under_curve, histograms, recall_at, separation_records, shares_above
from studies.results import Record

OF = Record("ELF", "", 0.0, world="studio")


def planted(seed: int = 0, same: int = 400, elsewhere: int = 5000) -> tuple:
    generator = np.random.default_rng(seed)
    return generator.normal(0.5, 0.15, same), generator.normal(0.1, 0.15, elsewhere)


def test_the_area_is_that_of_scikit_learn() -> None:
    same, elsewhere = planted()
    truth = np.repeat([1, 0], [len(same), len(elsewhere)])
    expected = roc_auc_score(truth, np.concatenate([same, elsewhere]))
    assert area_under_curve(histograms(same, elsewhere)) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("rate", [0.01, 0.001])
def test_recall_is_that_of_the_sorted_values(rate: float) -> None:
    same, elsewhere = planted()
    allowed = int(rate * len(elsewhere))
    threshold = np.sort(elsewhere)[-allowed - 1]
    got = recall_at(histograms(same, elsewhere), rate)
    assert got == pytest.approx(np.mean(same > threshold), abs=0.01)


def test_one_feature_for_all_places_recalls_nothing() -> None:
    counts = histograms(np.full(10, 0.9), np.full(100, 0.9))
    assert area_under_curve(counts) == pytest.approx(0.5)
    assert recall_at(counts, 0.01) == 0.0


def test_perfect_features_recall_all() -> None:
    counts = histograms(np.full(10, 1.0), np.full(100, -1.0))
    assert area_under_curve(counts) == 1.0
    assert recall_at(counts, 0.0) == 1.0


def test_shares_fall_from_all_to_none() -> None:
    for shares in shares_above(histograms(*planted())):
        assert shares[0] == 1.0
        assert shares[-1] == 0.0
        assert (np.diff(shares) <= 0).all()


def test_walks_are_pooled_and_the_threshold_is_read() -> None:
    walks = [
        histograms(np.array([0.5, 0.39]), np.array([0.0, 0.0, 0.4, 0.2])),
        histograms(np.array([0.41, 0.7]), np.array([0.1, 0.1, 0.1, 0.1])),
    ]
    found = {each.metric: each for each in separation_records(walks, 0.4, OF)}
    assert found["recall at 0.4"].value == 0.75
    assert found["false positives at 0.4"].value == 0.125
    assert found["mean similarity, same place"].value == pytest.approx(0.5, abs=0.001)
    recall = found["recall at 1 % false positives"]
    assert (recall.value, recall.low, recall.high, recall.world) == (0.75, 0.5, 1.0, "studio")


def test_walks_that_never_return_are_left_out_and_refused_alone() -> None:
    empty = histograms(np.array([]), np.array([0.1]))
    whole = histograms(np.array([0.9]), np.array([0.1]))
    assert separation_records([empty, whole], 0.4, OF) == separation_records([whole], 0.4, OF)
    with pytest.raises(InputError, match="no walk comes back to a place"):
        separation_records([empty], 0.4, OF)
