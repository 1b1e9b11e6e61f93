"""Indexes of clustered unit rows: answers against looking at all, changes, refusals."""

import builtins
import json
import shutil
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError, ParameterError, StoreError
from elfslam.serve.nearest import (
    NearestParameters,
    absorb,
    add_map,
    build_index,
    exact_search,
    open_index,
    remove_map,
)

SIZE, MAPS, SPOTS = 32, 12, 250
KINDS = {
    "flat": NearestParameters(kind="flat"),
    "ivf-flat": NearestParameters(kind="ivf-flat", cells=16, effort=8),
    "ivf-pq": NearestParameters(kind="ivf-pq", cells=16, effort=8, code_bytes=16),
    "refined": NearestParameters(kind="ivf-pq", cells=16, effort=8, code_bytes=16, refine=8),
    "hnsw": NearestParameters(kind="hnsw", effort=64),
}
SMALL = NearestParameters(kind="ivf-pq", cells=4, code_bytes=1, refine=2)
Built = Callable[[str], Path]
NEEDED = {"flat": 1.0, "ivf-flat": 0.95, "ivf-pq": 0.6, "refined": 0.93, "hnsw": 0.95}
"""Share of nearest spots that each must find here; codes of 16 bytes blur near ones."""


@pytest.fixture(autouse=True)
def _faiss() -> None:
    pytest.importorskip("faiss", reason="the extra buildings is not installed")


def unit(rows: F32) -> F32:
    return np.asarray(rows / np.linalg.norm(rows, axis=-1, keepdims=True), dtype=np.float32)


def clustered(generator: np.random.Generator, maps: int = MAPS) -> F32:
    """Rows with a mean in common, a part of their map and one of their own."""
    shared = generator.normal(size=SIZE)
    of_map = generator.normal(size=(maps, 1, SIZE)) + shared
    return unit((of_map + 0.7 * generator.normal(size=(maps, SPOTS, SIZE))).reshape(-1, SIZE))


@pytest.fixture(scope="module")
def rows() -> F32:
    return clustered(np.random.default_rng(5)).astype(np.float16).astype(np.float32)


@pytest.fixture(scope="module")
def queries(rows: F32) -> F32:
    generator = np.random.default_rng(6)
    picked = rows[generator.choice(len(rows), 200, replace=False)]
    return unit(picked + 0.08 * generator.normal(size=picked.shape))


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory, rows: F32) -> Callable[[str], Path]:
    """An index of each kind, built once."""

    @cache
    def build(name: str) -> Path:
        return made(tmp_path_factory.mktemp("built"), rows, name)

    return build


@pytest.fixture
def copy(built: Callable[[str], Path], tmp_path: Path) -> Callable[[str], Path]:
    """An index of a kind that a test may change."""
    return lambda name: shutil.copytree(built(name), tmp_path / "index")


def made(folder: Path, rows: F32, name: str = "ivf-flat") -> Path:
    counts = {f"map {k}": SPOTS for k in range(MAPS)}
    shards = [rows[:1000], rows[1000:1100], rows[1100:]]
    return build_index(shards, folder / "index", KINDS[name], encoder="elf-1", maps=counts)


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_finds_the_nearest(name: str, built: Built, rows: F32, queries: F32) -> None:
    wanted, cosines = exact_search([rows], queries, 10)
    index = open_index(built(name))
    ids, similarity = index.search(queries, 10)
    assert np.mean(ids[:, 0] == wanted[:, 0]) >= NEEDED[name]
    assert np.mean((ids == wanted[:, :1]).any(axis=1)) >= min(NEEDED[name] + 0.1, 0.97)
    assert (np.diff(similarity, axis=1) <= 0).all()
    tolerance = 0.15 if name == "ivf-pq" else 0.02
    np.testing.assert_allclose(similarity[:, 0], cosines[:, 0], atol=tolerance)
    assert (index.map_of(ids)[:, 0] == ids[:, 0] // SPOTS).all()


def test_exact_is_a_plain_sort(rows: F32, queries: F32) -> None:
    scores = queries @ rows.T
    wanted = np.argsort(-scores, axis=1, kind="stable")[:, :7]
    ids, similarity = exact_search([rows[:10], rows[10:1234], rows[1234:]], queries, 7)
    assert (ids == wanted).all()
    np.testing.assert_allclose(similarity, np.take_along_axis(scores, wanted, 1), atol=1e-6)


def test_exact_leaves_out_what_is_gone_and_says_where_there_is_no_more() -> None:
    rows = unit(np.eye(4, dtype=np.float32))
    ids, similarity = exact_search([rows], rows[:1], 4, np.array([True, False, False, True]))
    assert ids.tolist() == [[1, 2, -1, -1]]
    assert similarity.tolist() == [[0.0, 0.0, -1.0, -1.0]]


@pytest.mark.parametrize("name", KINDS)
def test_a_map_comes_is_absorbed_and_goes(name: str, copy: Built, rows: F32, queries: F32) -> None:
    folder = copy(name)
    before = open_index(folder)
    assert add_map(folder, "new", queries, encoder="elf-1").revision == 2
    for change in (None, absorb):
        if change is not None:
            change(folder)
        ids, similarity = open_index(folder).search(queries, 1)
        assert np.mean(ids[:, 0] == len(rows) + np.arange(len(queries))) >= NEEDED[name]
        assert (similarity > 0.9).all()
    assert not list(folder.glob(".*"))
    assert remove_map(folder, "new").revision == 4
    ids, _ = open_index(folder).search(queries, 5)
    assert ids.max() < len(rows)
    assert ids.min() >= 0
    assert (before.search(queries, 5)[0] == ids).mean() > 0.95


def test_a_map_of_the_first_ones_goes_and_its_name_is_free(copy: Built, rows: F32) -> None:
    folder = copy("ivf-flat")
    remove_map(folder, "map 3")
    part = rows[3 * SPOTS : 4 * SPOTS]
    ids, _ = open_index(folder).search(part, 5, effort=16)
    assert (ids // SPOTS != 3).all()
    add_map(folder, "map 3", part, encoder="elf-1")
    again = open_index(folder)
    ids, _ = again.search(part, 1)
    assert (ids[:, 0] == len(rows) + np.arange(SPOTS)).all()
    assert again.meta.maps[again.map_of(ids)[0, 0]].name == "map 3"


def test_what_no_revision_needs_is_removed(copy: Built, rows: F32) -> None:
    folder = copy("ivf-flat")
    for k in range(3):
        add_map(folder, f"new {k}", rows[:10], encoder="elf-1")
    absorb(folder)
    for k in range(2):
        remove_map(folder, f"new {k}")
    assert len(list(folder.glob("*.faiss"))) == 1
    assert not list(folder.glob("added-*"))
    assert len(list(folder.glob("nearest-*.json"))) == 2
    open_index(folder).search(rows[:3], 2)


def test_two_changes_at_once_are_not_both_made(
    copy: Built, rows: F32, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copy("ivf-flat")
    from elfslam.serve.nearest import folder as disk

    first = disk.read_meta(folder)
    add_map(folder, "one", rows[:5], encoder="elf-1")
    monkeypatch.setattr(disk, "read_meta", lambda _: first)
    with pytest.raises(StoreError, match="changed by another"):
        add_map(folder, "two", rows[:5], encoder="elf-1")
    assert len(list(folder.glob("added-*"))) == 1


def test_files_of_rows_are_linked_and_equal_builds_are_equal(tmp_path: Path, rows: F32) -> None:
    shard = tmp_path / "spots.npy"
    np.save(shard, rows.astype(np.float16))
    names = [tmp_path / "a", tmp_path / "b"]
    for name in names:
        build_index([shard], name, SMALL, encoder="e")
    assert (names[0] / "vectors-00000.npy").samefile(shard)
    metas = [json.loads((name / "nearest-000001.json").read_text()) for name in names]
    assert metas[0] == metas[1]
    assert metas[0]["encoder"] == "e"
    assert "faiss" in metas[0]["software"]


def test_nothing_is_found_beyond_the_last(tmp_path: Path, rows: F32) -> None:
    folder = build_index([rows[:3]], tmp_path / "i", NearestParameters(kind="flat"), encoder="e")
    ids, similarity = open_index(folder).search(rows[:2], 5)
    assert (ids[:, 3:] == -1).all()
    assert (similarity[:, 3:] == -1).all()
    assert (open_index(folder).map_of(ids)[:, 3:] == -1).all()


@pytest.mark.parametrize(
    ("shards", "text"),
    [
        ([], "got none"),
        ([np.zeros((0, SIZE), np.float32)], "got none"),
        ([2 * np.eye(SIZE, dtype=np.float32)], "length 1"),
        ([np.full((3, SIZE), np.nan, np.float32)], "length 1"),
        ([np.eye(SIZE, dtype=np.float32), np.eye(4, dtype=np.float32)], "shard 1: wanted numbers"),
        ([np.eye(SIZE, dtype=np.int64)], "int64"),
    ],
)
def test_rows_that_are_none_are_refused(shards: Sequence[Any], text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=text) as caught:
        build_index(shards, tmp_path / "index", KINDS["flat"], encoder="e")
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_refusals_of_an_index(copy: Built, tmp_path: Path, rows: F32) -> None:
    folder = copy("ivf-flat")
    index = open_index(folder)
    with pytest.raises(InputError, match="wanted elf-1"):
        add_map(folder, "new", rows[:4], encoder="other")
    with pytest.raises(InputError, match=r"got float32 \(4, 16\)"):
        index.search(rows[:4, :16], 1)
    with pytest.raises(InputError, match="length 1"):
        index.search(0 * rows[:4], 1)
    with pytest.raises(ParameterError, match="k: wanted 1"):
        index.search(rows[:4], 0)
    with pytest.raises(InputError, match="is in the index"):
        add_map(folder, "map 1", rows[:4], encoder="elf-1")
    with pytest.raises(InputError, match="is not in the index"):
        remove_map(folder, "nowhere")
    with pytest.raises(StoreError, match="already exists"):
        made(tmp_path, rows)
    with pytest.raises(StoreError, match="holds no index"):
        open_index(tmp_path)
    with pytest.raises(InputError, match="maps: wanted 3000 spots"):
        build_index([rows], tmp_path / "x", KINDS["flat"], encoder="e", maps={"a": 5})


@pytest.mark.parametrize(
    "wrong", [NearestParameters(kind="tree"), NearestParameters(kind="ivf-pq", code_bytes=7)]
)
def test_parameters_that_do_not_go_together(
    wrong: NearestParameters, tmp_path: Path, rows: F32
) -> None:
    with pytest.raises(ParameterError, match="wanted"):
        build_index([rows], tmp_path / "x", wrong, encoder="e")


@pytest.mark.parametrize("name", ["main.faiss", "vectors-00001.npy", "nearest-000001.json"])
def test_a_file_that_was_cut_off_is_refused(name: str, copy: Built) -> None:
    file = copy("refined") / name
    file.write_bytes(file.read_bytes()[:-7])
    with pytest.raises(StoreError, match=name) as caught:
        open_index(file.parent)
    assert "\n" not in str(caught.value)


def test_without_the_extra_only_flat_works(
    tmp_path: Path, rows: F32, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name == "faiss":
            raise ImportError(name)
        return plain(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    assert open_index(made(tmp_path, rows, "flat")).search(rows[:2], 1)[0].tolist() == [[0], [1]]
    with pytest.raises(InputError, match=r"run make studies"):
        build_index([rows], tmp_path / "x", KINDS["hnsw"], encoder="e")
