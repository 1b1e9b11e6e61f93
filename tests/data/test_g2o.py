"""Pose graphs as files: exact round trips, other programs agree, damage is refused."""

from __future__ import annotations

from pathlib import Path

import gtsam
import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.geometry import between
from elfslam.base.values import PoseGraph
from elfslam.data.g2o import read_g2o, write_g2o

INFORMATION = "400 1 2 300 3 100"
GRAPH = f"""VERTEX_SE2 10 1 2 0.5
VERTEX_SE2 30 2 2 0.5
# a remark

FIX 10
VERTEX_SE2 20 1.5 2 0.5
EDGE_SE2 10 20 0.5 0 0 {INFORMATION}
EDGE_SE2 20 30 0.5 0.1 0 {INFORMATION}
EDGE_SE2 10 20 0.6 0 0 {INFORMATION}
EDGE_SE2 30 10 -1 0 0.1 {INFORMATION}
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "graph.g2o"
    file.write_text(text)
    return file


def random_graph(generator: np.random.Generator) -> PoseGraph:
    root = generator.normal(size=(5, 3, 3))
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
    information = root @ np.swapaxes(root, 1, 2) + np.eye(3)
    information = (information + np.swapaxes(information, 1, 2)) / 2
    poses = generator.normal(size=(4, 3)) * [100.0, 100.0, 1.0]
    measurements = between(poses[edges[:, 0]], poses[edges[:, 1]])
    return PoseGraph(poses, edges, measurements, information, np.arange(5) >= 3)


def assert_same(one: PoseGraph, other: PoseGraph) -> None:
    for name in ("initial", "edges", "measurements", "information", "is_closure"):
        npt.assert_array_equal(getattr(one, name), getattr(other, name))


def test_what_the_rows_say(tmp_path: Path) -> None:
    graph = read_g2o(written(tmp_path, GRAPH))
    npt.assert_array_equal(graph.initial, [[1, 2, 0.5], [1.5, 2, 0.5], [2, 2, 0.5]])
    npt.assert_array_equal(graph.edges, [[0, 1], [1, 2], [0, 1], [2, 0]])
    npt.assert_array_equal(graph.measurements[3], [-1, 0, 0.1])
    npt.assert_array_equal(graph.information[0], [[400, 1, 2], [1, 300, 3], [2, 3, 100]])
    npt.assert_array_equal(graph.is_closure, [False, False, True, True])


def test_every_bit_comes_back(tmp_path: Path) -> None:
    graph = random_graph(np.random.default_rng(0))
    write_g2o(tmp_path / "a.g2o", graph)
    assert_same(read_g2o(tmp_path / "a.g2o"), graph)


def test_solved_poses_can_stand_in_for_the_initial_ones(tmp_path: Path) -> None:
    graph = random_graph(np.random.default_rng(1))
    write_g2o(tmp_path / "a.g2o", graph, graph.initial + 1.0)
    npt.assert_array_equal(read_g2o(tmp_path / "a.g2o").initial, graph.initial + 1.0)
    with pytest.raises(InputError, match="got 3 poses for a graph of 4"):
        write_g2o(tmp_path / "a.g2o", graph, graph.initial[:3])


def test_gtsam_reads_the_same_graph(tmp_path: Path) -> None:
    graph = random_graph(np.random.default_rng(2))
    write_g2o(tmp_path / "a.g2o", graph)
    problem, values = gtsam.readG2o(str(tmp_path / "a.g2o"), False)
    assert problem.size() == len(graph.edges)
    for k, pose in enumerate(graph.initial):
        theirs = values.atPose2(k)
        npt.assert_allclose(between(pose, [theirs.x(), theirs.y(), theirs.theta()]), 0, atol=1e-12)
    for k, information in enumerate(graph.information):
        noise = problem.at(k).noiseModel()
        npt.assert_allclose(noise.R().T @ noise.R(), information, rtol=1e-9, atol=1e-9)
    assert problem.error(values) == pytest.approx(0.0, abs=1e-18)


def test_poses_are_chained_where_only_edges_are_given(tmp_path: Path) -> None:
    lines = [line for line in GRAPH.splitlines() if "VERTEX" not in line]
    graph = read_g2o(written(tmp_path, "\n".join(lines)))
    npt.assert_allclose(graph.initial, [[0, 0, 0], [0.5, 0, 0], [1.0, 0.1, 0]])


@pytest.mark.parametrize("name", ["intel", "manhattan", "MIT", "ringCity"])
def test_published_graphs_come_back(shared_data: Path, tmp_path: Path, name: str) -> None:
    graph = read_g2o(shared_data / "pose_graphs" / f"{name}.g2o")
    assert (~graph.is_closure).sum() == len(graph.initial) - 1
    write_g2o(tmp_path / "a.g2o", graph)
    assert_same(read_g2o(tmp_path / "a.g2o"), graph)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("0.5 0.1", "0.5 x"), r"row 8 has 'x', wanted a finite number; repair that row"),
        (("0.5 0.1", "0.5 nan"), "row 8 has 'nan'"),
        (("EDGE_SE2 20 30 0.5", "EDGE_SE2 20 30"), "row 8 has 10 numbers after EDGE_SE2, wanted 1"),
        (("EDGE_SE2 30 10", "EDGE_SE2 31 10"), "row 10 joins 31 and 10, wanted two ids that have"),
        (("EDGE_SE2 30 10", "EDGE_SE2 30 30"), "row 10 joins 30 and 30"),
        (("VERTEX_SE2 20", "VERTEX_SE2 30"), "VERTEX_SE2 rows share an id; remove the repeated"),
        (("VERTEX_SE2 10", "VERTEX_SE3:QUAT 10"), "row 1 is VERTEX_SE3:QUAT, of a graph in space"),
        (("FIX 10", "VERTEX_XY 3 1 1"), "row 5 is VERTEX_XY, wanted VERTEX_SE2 or EDGE_SE2; rem"),
        (("0.1 400", "0.1 -400"), "row 10 has an information matrix that is not positive definite"),
    ],
)
def test_damage_is_named(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    assert change[0] in GRAPH
    with pytest.raises(InputError, match=says) as refused:
        read_g2o(written(tmp_path, GRAPH.replace(*change)))
    assert "\n" not in str(refused.value)


def test_files_that_hold_no_walk_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no EDGE_SE2 row"):
        read_g2o(written(tmp_path, "VERTEX_SE2 0 0 0 0\n"))
    with pytest.raises(InputError, match="no VERTEX_SE2 rows and no EDGE_SE2 from 1 to 5; add"):
        read_g2o(written(tmp_path, f"EDGE_SE2 1 5 1 0 0 {INFORMATION}".replace("1 5", "5 1")))
    with pytest.raises(InputError, match="cannot be read"):
        read_g2o(tmp_path / "absent.g2o")
