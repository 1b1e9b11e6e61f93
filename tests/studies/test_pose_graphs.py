"""The study of published pose graphs, on its smallest one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.data.g2o import read_g2o
from studies.finding import Given
from studies.pose_graphs import injected, measure_pose_graphs, ours, plain


def test_false_closures_do_not_move_the_answer(shared_data: Path, tmp_path: Path) -> None:
    finding = measure_pose_graphs(
        Given(shared_data, kept=tmp_path / "kept"), names=["ring", "MIT"], attacked=["ring"],
        seeds=[100], solvers={"ours": ours, "plain": plain},
    )  # fmt: skip
    clean, attacked = finding.rows[:2], finding.rows[2:]
    assert [row["set"] for row in clean] == ["ring", "MIT"]
    for row in clean:
        assert row["excess (%)"] < 0.1  # type: ignore[operator]
    assert clean[1]["plain LM"] > 10 * clean[1]["cost"]  # type: ignore[operator]
    assert [row["false (%)"] for row in attacked] == [10, 30, 50]
    for row in attacked:
        assert row["ours, worst"] == pytest.approx(row["clean"], rel=0.1)
        assert row["plain"] > 2 * row["clean"]  # type: ignore[operator]
    assert finding.page is not None
    assert len(finding.page.panels) == 4


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


def test_without_recordings_it_says_so() -> None:
    with pytest.raises(InputError, match="needs the real recordings; set ELFSLAM_DATA"):
        measure_pose_graphs(Given())
