"""What `elfslam show` draws: a run, a map or a world."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from elfslam.app.world_plan import world_plan
from elfslam.data.facts import FACTS, read_facts
from elfslam.data.folders import settled
from elfslam.data.map_files import MAP, read_map
from elfslam.data.runs import read_run
from elfslam.scoring.page import script_file
from elfslam.scoring.report import write_map_page, write_report
from elfslam.scoring.world_page import write_world_page
from elfslam.world.simulate import load_world

__all__ = ["drawing_of", "script_file"]


def drawing_of(what: str) -> Callable[[Path], None]:
    """What draws the page, once `what` has been read: a refusal makes no folder."""
    path = settled(Path(what))
    if (path / FACTS).exists():
        return partial(write_report, run=read_run(path), facts=read_facts(path))
    if path.suffix == ".npz" or (path / MAP).exists():
        return partial(write_map_page, floor_map=read_map(path))
    return partial(write_world_page, world=world_plan(load_world(what)))
