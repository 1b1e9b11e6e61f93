"""Only the same code gives the same results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from planted_work import square

from elfslam.app.workers.on_ray import check_version, code_digest, done_by_the_same, own_version
from elfslam.base.errors import WorkerError


def test_the_same_version_works() -> None:
    assert done_by_the_same(own_version(), square, 3) == 9


@pytest.mark.parametrize("name", ["elfslam", "code", "python", "numpy"])
def test_another_version_is_refused_before_it_works(name: str) -> None:
    wanted = replace(own_version(), **{name: "another"})
    with pytest.raises(WorkerError, match=f"got {name} .*, wanted another; install the same"):
        done_by_the_same(wanted, square, 3)


def test_the_digest_of_code_is_of_names_and_contents(tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    file = tmp_path / "room" / "line.py"
    file.write_text("x = 1\n")
    known = code_digest(tmp_path)
    (tmp_path / "notes.txt").write_text("not code")
    assert code_digest(tmp_path) == known
    file.write_text("x = 2\n")
    changed = code_digest(tmp_path)
    file.rename(tmp_path / "room" / "lines.py")
    assert len({known, changed, code_digest(tmp_path)}) == 3


def test_versions_say_what_differs() -> None:
    check_version(own_version(), own_version())
    with pytest.raises(WorkerError, match="install the same version there"):
        check_version(own_version(), replace(own_version(), code="0" * 16))
