"""What is drawn is read first, so that a refusal makes nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.base.errors import ElfslamError
from elfslam.studies.drawing import drawing_of


def test_a_world_is_drawn_where_it_is_wanted(tmp_path: Path) -> None:
    draw = drawing_of("studio")
    assert list(tmp_path.iterdir()) == []
    draw(tmp_path / "studio.html")
    assert (tmp_path / "studio.html").read_text().startswith("<!doctype html>")


@pytest.mark.parametrize("what", ["atlantis", "none.npz", "text.npz"])
def test_what_cannot_be_read_is_refused_at_once(what: str, tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no map")
    with pytest.raises(ElfslamError):
        drawing_of(str(tmp_path / what))
