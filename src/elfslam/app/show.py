"""What `elfslam show` draws, as one file: a run, a map, a world or a page that was saved."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from elfslam.app.world_plan import world_plan
from elfslam.data.facts import FACTS, read_facts
from elfslam.data.folders import settled
from elfslam.data.map_files import MAP, read_map
from elfslam.data.runs import read_run
from elfslam.scoring.page import script_file, self_contained
from elfslam.scoring.report import write_map_page, write_report
from elfslam.scoring.world_page import write_world_page
from elfslam.world.simulate import load_world

__all__ = ["drawing_of", "script_file"]


def drawing_of(what: str) -> Callable[[Path], None]:
    """What writes the page as one file, once `what` has been read: a refusal makes no folder.

    Raises InputError where `what` is nothing to be drawn.
    """
    if Path(what).suffix == ".html" and Path(what).is_file():
        return partial(_write, text=self_contained(Path(what)))
    return partial(_draw_alone, _page_writer(what))


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _draw_alone(draw: Callable[[Path], None], path: Path) -> None:
    with TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        draw(page)
        _write(path, self_contained(page))


def _page_writer(what: str) -> Callable[[Path], None]:
    path = settled(Path(what))
    if (path / FACTS).exists():
        return partial(write_report, run=read_run(path), facts=read_facts(path))
    if path.suffix == ".npz" or (path / MAP).exists():
        return partial(write_map_page, floor_map=read_map(path))
    return partial(write_world_page, world=world_plan(load_world(what)))
