"""Runs in the formats of other programs: what is written is what was mapped."""

from __future__ import annotations

from pathlib import Path

import gtsam
import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError, StoreError
from elfslam.data.g2o import read_g2o
from elfslam.data.recordings import write_recording
from elfslam.data.runs import ENCODER, FACTS, read_facts, read_run
from elfslam.data.tum import read_tum
from elfslam.exporting import Format, export
from elfslam.mapping import MapJob, map_into
from elfslam.senses import Modality, Settings
from elfslam.world.simulate import load_world, simulate


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exported")
    write_recording(simulate(load_world("studio"), 112, rounds=2)[0], folder / "walk")
    job = MapJob((Modality.ELF,), None, "compact", Settings(), overwrite=False)
    map_into(folder / "run", folder / "walk", job, lambda what, share: None)
    return folder / "run"


def test_the_pose_graph_opens_in_gtsam_and_says_the_same(run: Path, tmp_path: Path) -> None:
    export(run, tmp_path / "walk.g2o", Format.G2O)
    mapped = read_run(run)
    graph = read_g2o(tmp_path / "walk.g2o")
    assert graph.is_closure.sum() == len(mapped.closures.i) > 10
    npt.assert_allclose(graph.initial, mapped.trajectory.world_from_body, atol=1e-9)
    factors, initial = gtsam.readG2o(str(tmp_path / "walk.g2o"), False)
    assert factors.size() == len(graph.edges)
    assert initial.size() == len(graph.initial)


def test_the_trajectory_comes_back_from_tum(run: Path, tmp_path: Path) -> None:
    export(run, tmp_path / "walk.tum", Format.TUM)
    t_s, poses = read_tum(tmp_path / "walk.tum")
    trajectory = read_run(run).trajectory
    npt.assert_allclose(t_s, trajectory.t_s, atol=1e-6)
    npt.assert_allclose(poses[:, :2], trajectory.world_from_body[:, :2], atol=1e-8)
    turned = np.exp(1j * (poses[:, 2] - trajectory.world_from_body[:, 2]))
    npt.assert_allclose(turned, 1.0, atol=1e-8)


def test_the_encoder_is_the_one_beside_the_map(run: Path, tmp_path: Path) -> None:
    export(run, tmp_path / "used.onnx", Format.ONNX)
    assert (tmp_path / "used.onnx").read_bytes() == (run / ENCODER).read_bytes()


def test_what_is_no_run_is_refused_and_nothing_written(run: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=FACTS):
        export(tmp_path / "empty", tmp_path / "walk.g2o", Format.G2O)
    with pytest.raises(InputError, match=ENCODER):
        export(tmp_path / "empty", tmp_path / "used.onnx", Format.ONNX)
    with pytest.raises(StoreError, match="is a folder"):
        export(run, tmp_path / "empty", Format.TUM)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["empty"]


def test_the_run_states_how_many_closures_its_trajectory_bears_out(run: Path) -> None:
    assert "believed closures" in str(read_facts(run)["closures"])
