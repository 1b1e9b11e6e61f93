"""Floor maps on disk, whole and in tiles."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError, StoreError
from elfslam.base.values import FloorMap, Payload, Run
from elfslam.data import map_files
from elfslam.data.position_files import read_tum
from elfslam.data.runs import read_run, write_run
from elfslam.data.tiles import encoder_identity, stretches_of, tiles_of
from elfslam.stages.floormap import MapQuality
from tests.data.phone_maps import map_of_parts


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
def test_arrays_of_other_kinds_fail(tmp_path: Path, run: Run, name: str, array: np.ndarray) -> None:
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


PLACES = np.array([[7.9, -0.1], [0.0, 0.0], [8.0, 0.0], [-3.0, 7.0], [7.0, 7.9], [0.5, 0.0]])
ORDER = [3, 0, 1, 4, 5, 2]
"""The spots by the squares (-1, 0), (0, -1), (0, 0) and (1, 0)."""


def a_map() -> FloorMap:
    generator = np.random.default_rng(3)
    count = len(PLACES)
    root = generator.normal(size=(count, 2, 2))
    elfs = Payload("elf", "abc", generator.normal(0, 0.09, (count, 128)).astype(np.float32))
    return FloorMap(
        xy_m=PLACES,
        heading_rad=generator.uniform(-3, 3, count),
        walk=np.array([0, 0, 0, 0, 0, 2]),
        order=np.array([5, 0, 300, 256, 255, 5]),
        covariance_m2=root @ root.transpose(0, 2, 1),
        payloads=(elfs,),
        parameters_digest="d",
        sources=("one", "two", "three"),
        weight=generator.uniform(0.1, 1, count),
    )


def test_what_is_cut_is_put_together() -> None:
    given = a_map()
    tiles, stretches = tiles_of(given), stretches_of(given)
    assert [(tile.square, tile.spots) for tile in tiles] == [
        ((-1, 0), 1), ((0, -1), 1), ((0, 0), 3), ((1, 0), 1)
    ]  # fmt: skip
    assert [(each.walk, each.spots) for each in stretches] == [(0, 3), (0, 2), (2, 1)]
    parts = [tile.content for tile in tiles], [(each.walk, each.content) for each in stretches]
    read = map_of_parts(*parts, encoder=encoder_identity(given), sources=given.sources)
    for name in ("walk", "order"):
        npt.assert_array_equal(getattr(read, name), getattr(given, name)[ORDER])
    for name in ("xy_m", "heading_rad", "covariance_m2", "weight"):
        wanted = getattr(given, name)[ORDER].astype(np.float32)
        npt.assert_array_equal(getattr(read, name), wanted)
    for payload, wanted in zip(read.payloads, given.payloads, strict=True):
        assert (payload.kind, payload.encoder) == (wanted.kind, wanted.encoder)
    halves = given.payloads[0].vectors[ORDER].astype(np.float16)
    npt.assert_array_equal(read.payloads[0].vectors, halves.astype(np.float32))


def test_a_change_stays_in_its_tile() -> None:
    given = a_map()
    weight = given.weight.copy()
    weight[2] /= 2
    faded = replace(given, weight=weight)
    before, after = tiles_of(given), tiles_of(faded)
    assert stretches_of(faded) == stretches_of(given)
    assert [a.content == b.content for a, b in zip(before, after, strict=True)] == [
        True, True, True, False
    ]  # fmt: skip


def test_spots_that_their_order_does_not_tell_apart_keep_their_features() -> None:
    given = replace(a_map(), walk=np.zeros(6, dtype=np.int64), order=np.zeros(6, dtype=np.int64))
    tiles = [tile.content for tile in tiles_of(given)]
    stretches = [(each.walk, each.content) for each in stretches_of(given)]
    read = map_of_parts(tiles, stretches, encoder="abc", sources=("one",))
    halves = given.payloads[0].vectors[ORDER].astype(np.float16)
    npt.assert_array_equal(read.payloads[0].vectors, halves.astype(np.float32))


def test_a_map_without_learnt_features_is_refused() -> None:
    given = a_map()
    other = Payload("elf", "spectral-1", np.zeros((len(PLACES), 576), dtype=np.float32))
    for payloads in ((), (other,)):
        with pytest.raises(InputError, match="by its echoes"):
            stretches_of(replace(given, payloads=payloads))
