"""The distinctness study on a few spots."""

import numpy as np
import pytest

from studies.distinctness import (
    CHIRP,
    ECHOES,
    MEAN_M,
    RECOGNISED,
    SPOTS_SHOWN,
    TONE,
    TSNE_1,
    TSNE_2,
    measure_distinctness,
)
from studies.results import Record
from studies.study import StudyContext


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return measure_distinctness(StudyContext(), spots=10)


def test_a_chirp_tells_spots_apart_better_than_a_tone(records: list[Record]) -> None:
    found = {(each.method, each.metric): each.value for each in records}
    assert found[CHIRP, RECOGNISED] > found[TONE, RECOGNISED]
    assert found[CHIRP, MEAN_M] <= found[TONE, MEAN_M]


def test_echoes_of_a_chirp_lie_nearest_to_their_own_spots_cloud(records: list[Record]) -> None:
    axes = {
        metric: np.array([r.value for r in records if (r.method, r.metric) == (CHIRP, metric)])
        for metric in (TSNE_1, TSNE_2)
    }
    plane = np.column_stack(list(axes.values())).reshape(SPOTS_SHOWN, ECHOES, 2)
    middles = plane.mean(axis=1)
    nearest = np.linalg.norm(plane[:, :, None] - middles, axis=3).argmin(axis=2)
    assert (nearest == np.arange(SPOTS_SHOWN)[:, None]).mean() > 0.95
