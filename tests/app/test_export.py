"""Runs in the formats of other programs: what is written is what was mapped."""

import json
import shutil
from pathlib import Path

import gtsam
import numpy as np
import numpy.testing as npt
import pytest

from elfslam.app.export import ExportContext, export, map_of
from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.base.enums import Format, Modality
from elfslam.base.errors import InputError, ParameterError, StoreError
from elfslam.data.geographic import Origin, from_lon_lat
from elfslam.data.imdf import Venue
from elfslam.data.map_exports import read_g2o
from elfslam.data.map_files import ENCODER, FACTS, MAP, read_facts
from elfslam.data.position_files import read_tum
from elfslam.data.recordings import write_recording
from elfslam.data.runs import read_run
from elfslam.world.simulate import load_world, simulate
from tests.data.imdf_rules import faults_of, read_imdf

PLACE = Venue("Studio", "museum", "Hauptstrasse 1", "Bern", "CH", "Ground floor", 0)


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


def test_a_map_alone_becomes_what_a_run_does(run: Path, tmp_path: Path) -> None:
    told = ExportContext(Origin(47.0, 8.0), PLACE)
    for to in (Format.GEOJSON, Format.PARQUET, Format.IMDF):
        export(run, tmp_path / "of_run", to, told, overwrite=True)
        export(run / MAP, tmp_path / "of_map", to, told, overwrite=True)
        if to != Format.IMDF:
            assert (tmp_path / "of_run").read_bytes() == (tmp_path / "of_map").read_bytes()
    assert faults_of(read_imdf(tmp_path / "of_map")) == []
    export(run, tmp_path / "floor.yaml", Format.ROS, ExportContext(pixel_m=0.1))
    assert "resolution: 0.1" in (tmp_path / "floor.yaml").read_text()


def test_what_nobody_can_guess_is_asked_for(run: Path, tmp_path: Path) -> None:
    for to in (Format.GEOJSON, Format.IMDF):
        with pytest.raises(ParameterError, match="origin"):
            export(run, tmp_path / "out", to, ExportContext(place=PLACE))
    with pytest.raises(ParameterError, match="place"):
        export(run, tmp_path / "out", Format.IMDF, ExportContext(Origin(47.0, 8.0)))
    with pytest.raises(ParameterError, match="resolution"):
        export(run, tmp_path / "floor.yaml", Format.ROS, ExportContext(pixel_m=0.0))
    assert list(tmp_path.iterdir()) == []


def test_a_run_without_a_map_gives_a_spot_per_footstep(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "run")
    (tmp_path / "run" / MAP).unlink()
    trajectory = read_run(run).trajectory
    spots = map_of(tmp_path / "run")
    npt.assert_allclose(spots.xy_m, trajectory.world_from_body[:, :2])
    npt.assert_allclose(spots.covariance_m2, trajectory.covariance[:, :2, :2])


def test_coverage_beside_a_map_becomes_squares(run: Path, tmp_path: Path) -> None:
    shutil.copyfile(run / MAP, tmp_path / MAP)
    text = "x_m,y_m,walks,spots,sigma_m\n0.25,0.25,2,9,0.1\n0.75,0.25,1,3,0.2\n"
    (tmp_path / "quality.csv").write_text(text)
    export(tmp_path, tmp_path / "m.geojson", Format.GEOJSON, ExportContext(Origin(47.0, 8.0)))
    features = json.loads((tmp_path / "m.geojson").read_text())["features"]
    cells = [each for each in features if each["properties"]["kind"] == "coverage"]
    assert [each["properties"]["walks"] for each in cells] == [2, 1]
    corners = from_lon_lat(Origin(47.0, 8.0), np.array(cells[0]["geometry"]["coordinates"][0]))
    npt.assert_allclose(np.ptp(corners, axis=0), 0.5, atol=1e-3)
    npt.assert_allclose(corners[:-1].mean(axis=0), 0.25, atol=1e-3)


def test_what_is_no_run_is_refused_and_nothing_written(run: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=FACTS):
        export(tmp_path / "empty", tmp_path / "walk.g2o", Format.G2O)
    with pytest.raises(InputError, match=ENCODER):
        export(tmp_path / "empty", tmp_path / "used.onnx", Format.ONNX)
    with pytest.raises(StoreError, match="is no file"):
        export(run, tmp_path / "empty", Format.TUM)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["empty"]


def test_the_run_states_how_many_closures_its_trajectory_bears_out(run: Path) -> None:
    assert "believed closures" in str(read_facts(run)["closures"])
