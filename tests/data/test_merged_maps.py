"""Maps of several walks on disk."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt

from elfslam.base.values import Run
from elfslam.data.map_files import read_map
from elfslam.data.merged_maps import QUALITY_COLUMNS, fill_merged, is_merged, write_quality
from elfslam.data.tum import read_tum
from elfslam.stages.floormap import MapQuality

QUALITY = MapQuality(
    xy_m=[[0.5, 0.5], [1.5, 0.5]],
    walks=[1, 2],
    spots=[3, 4],
    weight=[1.0, 0.9],
    sigma_m=[0.1, 0.2],
    error_m=[np.nan, 0.25],
    changed=[False, True],
)


def written(folder: Path, run: Run) -> None:
    trajectories = {"day/one": run.trajectory}
    facts = {"walks": ["day/one"]}
    folder.mkdir()
    fill_merged(folder, run.floor_map, QUALITY, trajectories, facts=facts, encoder=b"onnx")


def test_a_folder_holds_map_trajectories_quality_and_facts(tmp_path: Path, run: Run) -> None:
    folder = tmp_path / "map"
    written(folder, run)
    assert is_merged(folder)
    assert not is_merged(tmp_path)
    npt.assert_array_equal(read_map(folder).xy_m, run.floor_map.xy_m)
    poses = read_tum(folder / "trajectories" / "day-one.tum")[1]
    npt.assert_allclose(poses, run.trajectory.world_from_body, atol=1e-6)
    assert json.loads((folder / "merge.json").read_text()) == {"walks": ["day/one"]}
    assert (folder / "encoder.onnx").read_bytes() == b"onnx"


def test_squares_of_a_map_in_a_countrys_grid_keep_their_places(tmp_path: Path) -> None:
    far = replace(QUALITY, xy_m=np.add(QUALITY.xy_m, [500_000.0, 5_000_000.0]))
    write_quality(far, tmp_path / "quality.csv")
    table = np.genfromtxt(tmp_path / "quality.csv", delimiter=",", skip_header=1)
    npt.assert_array_equal(table[:, :2], far.xy_m)


def test_an_error_that_nobody_knows_stays_empty(tmp_path: Path, run: Run) -> None:
    written(tmp_path / "map", run)
    lines = (tmp_path / "map" / "quality.csv").read_text().splitlines()
    assert lines == [
        ",".join(QUALITY_COLUMNS),
        "0.5,0.5,1,3,1,0.1,,0",
        "1.5,0.5,2,4,0.9,0.2,0.25,1",
    ]
