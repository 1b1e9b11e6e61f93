"""The study of published pose graphs, on its smallest ones."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.data.map_exports import read_g2o
from studies.pose_graphs import (
    COST,
    OURS,
    PLAIN_LM,
    RMSE,
    STUDY,
    WORST,
    injected,
    measure_pose_graphs,
)
from studies.study import StudyContext


def test_false_closures_do_not_move_the_answer(shared_data: Path) -> None:
    records = measure_pose_graphs(StudyContext(shared_data), **STUDY.fast)
    found = {(r.method, r.world, r.condition, r.metric): r for r in records}
    for name in ("ring", "MIT"):
        ours = found[OURS, name, "", COST]
        assert ours.value == pytest.approx(ours.paper, rel=1e-3)
    assert found[PLAIN_LM, "MIT", "", COST].value > 10 * found[OURS, "MIT", "", COST].value
    clean = found[PLAIN_LM, "ring", "0 % false closures", RMSE].value
    for condition in (f"{share} % false closures" for share in (10, 30, 50)):
        assert found[OURS, "ring", condition, WORST].value == pytest.approx(clean, rel=0.1)
        assert found[PLAIN_LM, "ring", condition, RMSE].value > 2 * clean


def test_what_is_injected_says_that_random_poses_are_one(shared_data: Path) -> None:
    graph = read_g2o(shared_data / "pose_graphs" / "ring.g2o")
    attacked = injected(graph, 0.5, 7)
    assert len(attacked.edges) - len(graph.edges) == 13
    false = attacked.edges[-13:]
    assert (np.abs(false[:, 0] - false[:, 1]) > 1).all()
    assert (attacked.measurements[-13:] == 0).all()
    assert attacked.is_closure[-13:].all()
    np.testing.assert_array_equal(injected(graph, 0.5, 7).edges, attacked.edges)
    assert (injected(graph, 0.5, 8).edges[-13:] != false).any()
