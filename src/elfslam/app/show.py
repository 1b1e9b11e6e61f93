"""What `elfslam show` draws: a run, a map or a world."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

from elfslam.app.world_plan import world_plan
from elfslam.data.facts import FACTS, read_facts
from elfslam.data.folders import settled
from elfslam.data.map_files import MAP, read_map
from elfslam.data.runs import read_run
from elfslam.scoring.page import embed_script, script_file
from elfslam.scoring.report import write_map_page, write_report
from elfslam.scoring.world_page import write_world_page
from elfslam.world.simulate import load_world

__all__ = ["drawing_of", "script_file"]


class Draw(Protocol):
    """Writes a page to a file: with the drawing script beside it, or within."""

    def __call__(self, page: Path, *, self_contained: bool = False) -> None: ...


class Write(Protocol):
    """Writes a page that finds the drawing script beside it."""

    def __call__(self, path: Path) -> None: ...


def drawing_of(what: str) -> Draw:
    """What draws the page, once `what` has been read: a refusal makes no folder."""
    return partial(_draw, write=_writer_of(what))


def _draw(page: Path, write: Write, *, self_contained: bool = False) -> None:
    if not self_contained:
        write(page)
        return
    with TemporaryDirectory() as folder:
        alone = Path(folder, "page.html")
        write(alone)
        embed_script(alone)
        page.write_bytes(alone.read_bytes())


def _writer_of(what: str) -> Write:
    path = settled(Path(what))
    if (path / FACTS).exists():
        return partial(write_report, run=read_run(path), facts=read_facts(path))
    if path.suffix == ".npz" or (path / MAP).exists():
        return partial(write_map_page, floor_map=read_map(path))
    return partial(write_world_page, world=world_plan(load_world(what)))
