"""What `elfslam show` draws, as one file: a run, a map, a world or a page that was saved."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from elfslam.app.world_plan import world_plan
from elfslam.data.atomic_files import new_file, settled
from elfslam.data.facts import FACTS, read_facts
from elfslam.data.map_files import MAP, read_map
from elfslam.data.runs import read_run
from elfslam.scoring.page import script_file, self_contained
from elfslam.scoring.report import write_map_page, write_report
from elfslam.scoring.world_page import write_world_page
from elfslam.world.simulate import load_world

__all__ = ["script_file", "show_into"]


def show_into(out: Path, what: str, *, overwrite: bool = False) -> None:
    """Write the page of `what` as one file; an older one is only replaced with `overwrite`.

    Raises InputError where `what` is nothing to be drawn, StoreError.
    """
    with new_file(out, overwrite=overwrite, reads=[what]) as file, TemporaryDirectory() as folder:
        page = Path(what)
        if page.suffix != ".html" or not page.is_file():
            page = Path(folder) / "page.html"
            _page_writer(what)(page)
        file.write_text(self_contained(page), encoding="utf-8")


def _page_writer(what: str) -> Callable[[Path], None]:
    path = settled(Path(what))
    if (path / FACTS).exists():
        return partial(write_report, run=read_run(path), facts=read_facts(path))
    if path.suffix == ".npz" or (path / MAP).exists():
        return partial(write_map_page, floor_map=read_map(path))
    return partial(write_world_page, world=world_plan(load_world(what)))
