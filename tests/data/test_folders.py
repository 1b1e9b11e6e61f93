"""Nothing half-written stays, nothing else is overwritten."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.base.errors import StoreError
from elfslam.data.folders import new_file, new_folder


def _half_written_folder(folder: Path) -> None:
    with new_folder(folder) as partial:
        (partial / "a").write_text("x")
        raise KeyboardInterrupt


def _half_written_file(file: Path) -> None:
    with new_file(file) as partial:
        partial.write_text("half")
        raise ZeroDivisionError


def test_a_folder_appears_whole(tmp_path: Path) -> None:
    wanted = tmp_path / "deep" / "new"
    with new_folder(wanted) as partial:
        (partial / "a").write_text("x")
        assert not wanted.exists()
    assert [path.relative_to(tmp_path) for path in tmp_path.rglob("a")] == [
        Path("deep", "new", "a")
    ]


def test_an_interrupted_folder_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        _half_written_folder(tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


def test_an_empty_folder_may_be_filled(tmp_path: Path) -> None:
    (tmp_path / "new").mkdir()
    with new_folder(tmp_path / "new") as partial:
        (partial / "a").write_text("x")
    assert (tmp_path / "new" / "a").is_file()
    assert len(list(tmp_path.iterdir())) == 1


def test_a_file_in_the_way_is_kept(tmp_path: Path) -> None:
    (tmp_path / "new").write_text("precious")
    with pytest.raises(StoreError, match="already exists"), new_folder(tmp_path / "new"):
        pass
    with pytest.raises(StoreError, match="cannot be written"), new_folder(tmp_path / "new" / "b"):
        pass
    assert (tmp_path / "new").read_text() == "precious"


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    file = tmp_path / "fixes.csv"
    file.write_text("old")
    with pytest.raises(ZeroDivisionError):
        _half_written_file(file)
    assert file.read_text() == "old"
    with new_file(file) as partial:
        partial.write_text("new")
    assert file.read_text() == "new"
    assert list(tmp_path.iterdir()) == [file]
