"""Floor maps on disk."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import StoreError
from elfslam.base.values import Run
from elfslam.data import map_files
from elfslam.data.position_files import read_tum
from elfslam.data.runs import read_run, write_run
from elfslam.stages.floormap import MapQuality


def test_round_trip(tmp_path: Path, run: Run) -> None:
    map_files.write_map(run.floor_map, tmp_path / "map.npz")
    for path in (tmp_path, tmp_path / "map.npz"):
        read = map_files.read_map(path)
        for name in ("xy_m", "heading_rad", "walk", "order", "covariance_m2"):
            np.testing.assert_array_equal(getattr(read, name), getattr(run.floor_map, name))
        assert (read.parameters_digest, read.sources) == ("abc", ("hall",))
        for payload, wanted in zip(read.payloads, run.floor_map.payloads, strict=True):
            assert (payload.kind, payload.encoder) == (wanted.kind, wanted.encoder)
            np.testing.assert_array_equal(payload.vectors, wanted.vectors)


def test_the_age_of_spots_is_kept_and_older_files_have_none(tmp_path: Path, run: Run) -> None:
    aged = replace(run.floor_map, weight=[1, 0.5, 1, 1, 0.2], changed=[0, 1, 0, 0, 1])
    map_files.write_map(aged, tmp_path / "map.npz")
    read = map_files.read_map(tmp_path)
    np.testing.assert_array_equal(read.weight, aged.weight)
    np.testing.assert_array_equal(read.changed, aged.changed)
    with np.load(tmp_path / "map.npz") as stored:
        older = {name: stored[name] for name in stored.files if name not in ("weight", "changed")}
    np.savez(tmp_path / "map.npz", **older)
    assert (map_files.read_map(tmp_path).weight == 1).all()


def test_features_of_an_earlier_version_are_refused(tmp_path: Path, run: Run) -> None:
    """They kept what the echoes of a walk have in common; their names lack what says otherwise."""
    for name, labels, read in (
        ("map.npz", "payload_encoders", map_files.read_map),
        ("features.npz", "encoder", read_run),
    ):
        folder = tmp_path / name
        write_run(run, folder, facts={}, encoder=None)
        with np.load(folder / name) as archive:
            arrays = dict(archive)
        arrays[labels] = np.char.replace(arrays[labels], map_files.OWN, "")
        np.savez(folder / name, **arrays)
        with pytest.raises(StoreError, match=r"features are those of an earlier version.*again"):
            read(folder)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("sources", np.array("hall")),
        ("sources", np.array([["hall"]])),
        ("payload_encoders", np.array([["a", "b"]])),
        ("payload_kinds", np.array(["elf"])),
        ("payload_0", np.zeros((1, 2))),
        ("payload_0", np.full((5, 8), np.nan)),
        ("walk", np.full(5, np.nan)),
        ("xy_m", np.full((5, 2), 2e8)),
        ("xy_m", np.full((5, 2), np.nan)),
        ("covariance_m2", np.tile(-np.eye(2), (5, 1, 1))),
        ("covariance_m2", np.tile([[1.0, 0.5], [0.4, 1.0]], (5, 1, 1))),
        ("covariance_m2", np.tile([[1.0, 2.0], [2.0, 1.0]], (5, 1, 1))),
        ("weight", np.zeros(3)),
    ],
)
def test_arrays_of_another_kind_are_refused(
    tmp_path: Path, run: Run, name: str, array: np.ndarray
) -> None:
    map_files.write_map(run.floor_map, tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz") as stored:
        np.savez(tmp_path / "map.npz", **{**stored, name: array})
    with pytest.raises(StoreError, match=r"map\.npz: is no floor map") as refused:
        map_files.read_map(tmp_path)
    assert "\n" not in str(refused.value)


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
    map_files.fill_merged(
        folder, run.floor_map, QUALITY, trajectories, facts=facts, encoder=b"onnx"
    )


def test_a_folder_holds_map_trajectories_quality_and_facts(tmp_path: Path, run: Run) -> None:
    folder = tmp_path / "map"
    written(folder, run)
    assert map_files.is_merged(folder)
    assert not map_files.is_merged(tmp_path)
    npt.assert_array_equal(map_files.read_map(folder).xy_m, run.floor_map.xy_m)
    poses = read_tum(folder / "trajectories" / "day-one.tum")[1]
    npt.assert_allclose(poses, run.trajectory.world_from_body, atol=1e-6)
    assert json.loads((folder / "merge.json").read_text()) == {"walks": ["day/one"]}
    assert (folder / "encoder.onnx").read_bytes() == b"onnx"


def test_squares_of_a_map_in_a_countrys_grid_keep_their_places(tmp_path: Path) -> None:
    far = replace(QUALITY, xy_m=np.add(QUALITY.xy_m, [500_000.0, 5_000_000.0]))
    map_files.write_quality(far, tmp_path / "quality.csv")
    table = np.genfromtxt(tmp_path / "quality.csv", delimiter=",", skip_header=1)
    npt.assert_array_equal(table[:, :2], far.xy_m)


def test_an_error_that_nobody_knows_stays_empty(tmp_path: Path, run: Run) -> None:
    written(tmp_path / "map", run)
    lines = (tmp_path / "map" / "quality.csv").read_text().splitlines()
    assert lines == [
        ",".join(map_files.QUALITY_COLUMNS),
        "0.5,0.5,1,3,1,0.1,,0",
        "1.5,0.5,2,4,0.9,0.2,0.25,1",
    ]
