"""The process of one job, given its folder, as `workers.child` runs it.

The folder holds `task.json` and, under `given/`, recordings and maps by name; what is made goes to
`out/`. A line of JSON on the standard output for each thing that is being done, one at the end for
what came of it.
"""

from __future__ import annotations

import errno
import json
import os
import resource
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from elfslam.app.locate import encoder_of
from elfslam.app.map import MapJob, Pose, kept_closures, map_into, refuse_unclosed
from elfslam.app.merge import merge_into
from elfslam.app.settings import Settings
from elfslam.base.arrays import F64
from elfslam.base.enums import Modality, Mode, parse_stretch
from elfslam.base.errors import ElfslamError, NoAnswerError
from elfslam.base.geometry import path_length_m
from elfslam.base.values import Announce, FixStatus, FloorMap, Run
from elfslam.data.building_files import floor_folder, is_building, passage_facts, read_building
from elfslam.data.map_exports import walk_lines
from elfslam.data.map_files import MISSING, read_facts, read_map
from elfslam.data.position_files import write_fixes
from elfslam.data.recordings import read_recording
from elfslam.data.runs import read_run
from elfslam.serve.jobs.executors import DISK_FULL, FIXES, GIVEN, OUT, TASK, Progress, Result
from elfslam.serve.parsing.child import bound
from elfslam.slam import pipeline as slam
from elfslam.slam.floor_location import locate_in_building
from elfslam.slam.merging import MergeParameters

if TYPE_CHECKING:
    from elfslam.serve.store.tables import MapFacts

ENCODER = "compact"
STAGES = {
    "motion": 0.02,
    "echoes": 0.05,
    "step length": 0.3,
    "features": 0.45,
    "similarity": 0.6,
    "closures": 0.65,
    "graph": 0.75,
    "map": 0.95,
}
"""Roughly how much of the work lies behind when a stage of mapping begins."""
NICENESS = 10
"""The server itself goes first."""

Json = dict[str, Any]
Work = Callable[[Path, Json, Announce], tuple[Json, str | None]]
"""Gives facts, and the problem of an honest failure that leaves something behind."""


def main() -> None:
    """Work on the task of the folder that is named on the command line."""
    work_on(Path(sys.argv[1]))


def work_on(folder: Path) -> None:
    """Work on the task of a folder; this process is for that alone."""
    told = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    os.dup2(2, 1)  # whatever a library prints must not look like ours
    task = json.loads((folder / TASK).read_text(encoding="utf-8"))
    _limit(task["limits"])
    _say(told, _result(folder, task, lambda *doing: _say(told, Progress(*doing))))


def _result(folder: Path, task: Json, announce: Announce) -> Result:
    """What came of the task; what a user cannot act on is raised."""
    try:
        facts, problem = WORK[task["kind"]](folder, task, announce)
    except ElfslamError as error:
        problem = _no_space(error.__cause__, task) or in_words(error, folder)
        return Result(None, problem)
    except (MemoryError, OSError) as error:
        traceback.print_exc()
        if (problem := _no_space(error, task)) is None:
            raise
        return Result(None, problem)
    return Result(facts, problem)


def _no_space(error: BaseException | None, task: Json) -> str | None:
    """What to say of an error where memory or disk did not suffice."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return DISK_FULL
    if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.EFBIG:
        most = task["limits"]["bytes"] / 2**30
        return f"needs more than the {most:.2g} GiB that a job may take; cut the recording up"
    return None


def in_words(error: ElfslamError, folder: Path) -> str:
    """The line of an error, without the paths of this server."""
    line = " ".join(str(error).split())
    return line.replace(f"{folder / GIVEN}/", "").replace(f"{folder}/", "")


def _map(folder: Path, task: Json, announce: Announce) -> tuple[Json, str | None]:
    """As `elfslam map` does."""
    by = tuple(Modality(name) for name in task["by"])
    kept_s = parse_stretch(task.get("from_s"), task.get("until_s"))
    start = _start_pose(task["start_pose"])
    job = MapJob(by, start, ENCODER, Settings(), overwrite=False, kept_s=kept_s)

    def stage(what: str, share: float | None) -> None:
        name = what.rpartition(": ")[2]
        announce(name, STAGES.get(name) if share is None else share)

    run = map_into(folder / OUT, folder / GIVEN / task["recording"], job, stage)
    out = folder / OUT
    facts = {"floors": facts_of_floors(out)} if is_building(out) else dict(facts_of_run(run))
    problem = None
    try:
        refuse_unclosed(run)
    except NoAnswerError as failure:
        problem = str(failure)
    return {**facts, **_said_of_run(out)}, problem


def facts_of_floors(out: Path) -> list[MapFacts]:
    """What is told of each floor of a building, in their order."""
    building = read_building(out)
    return [
        {
            **facts_of_run(read_run(floor_folder(out, floor.level))),
            "level": floor.level,
            "height_m": floor.height_m,
            "passages": [passage_facts(each) for each in building.passages_at(floor.level)],
        }
        for floor in building.floors
    ]


def _start_pose(given: list[float] | None) -> Pose | None:
    if given is None:
        return None
    x_m, y_m, heading_rad = map(float, given)
    return x_m, y_m, heading_rad


def facts_of_run(run: Run) -> MapFacts:
    """What is told of a run."""
    xy_m, t_s = run.trajectory.world_from_body[:, :2], run.trajectory.t_s
    return {
        "walks": 1,
        "footsteps": len(t_s),
        "duration_s": round(float(t_s[-1] - t_s[0]), 2),
        "distance_m": round(path_length_m(xy_m), 2),
        "closures": len(run.closures.i),
        "closures_kept": kept_closures(run),
        "status": run.trajectory.status,
        "by": run.similarity.kind,
        "bounds_m": _bounds(xy_m),
    }


def _said_of_run(out: Path) -> Json:
    """What run.json says of the stretch that was mapped: who headed it, and what it lacked."""
    told = read_facts(out)
    return {name: told[name] for name in ("kept_s", "heading", MISSING) if name in told}


def _merge(folder: Path, task: Json, announce: Announce) -> tuple[Json, str | None]:
    """As `elfslam merge` does."""
    paths = [folder / GIVEN / name for name in task["maps"]]
    known = task["known_starts"]
    made = merge_into(folder / OUT, paths, MergeParameters(), announce, known_starts=known)
    floor_map = made.floor_map
    facts: MapFacts = {
        "walks": len(floor_map.sources),
        "spots": len(floor_map.xy_m),
        "distance_m": round(sum(path_length_m(line) for _, line in walk_lines(floor_map)), 2),
        "pairs": made.pairs,
        "refused": made.refused,
        "bounds_m": _bounds(floor_map.xy_m),
    }
    return dict(facts), None


def _locate(folder: Path, task: Json, announce: Announce) -> tuple[Json, str | None]:
    """As `elfslam locate` does, on all floors of its building whose maps have its encoder."""
    known, mode, given = Settings(), Mode(task["mode"]), folder / GIVEN
    announce("reading", 0.0)
    floor_map = read_map(given / task["map"])
    every = {int(level): read_map(given / name) for level, name in task["floors"].items()}
    floors = {
        level: each for level, each in every.items() if _heard_by(each) == _heard_by(floor_map)
    }
    recording = read_recording(given / task["recording"], known.chirp)
    announce("locating", 0.2)
    encoder = encoder_of(given / task["map"], floor_map)
    fixes = (
        locate_in_building(recording, floors, encoder, known, mode=mode)
        if len(floors) > 1
        else slam.locate(recording, floor_map, encoder, known, mode=mode)
    )
    (folder / OUT).mkdir()
    write_fixes(fixes, folder / OUT / FIXES)
    counts = {status.name: int((fixes.status == status).sum()) for status in FixStatus}
    nowhere = f"{task['recording']}: nowhere in {task['place']}; is it the same place?"
    return {"counts": counts}, None if counts["OK"] else nowhere


def _heard_by(floor_map: FloorMap) -> set[str]:
    """The encoders of a map."""
    return {each.encoder for each in floor_map.payloads}


WORK: Mapping[str, Work] = {"map": _map, "merge": _merge, "locate": _locate}


def _bounds(xy_m: F64) -> list[float]:
    corners = np.array([xy_m.min(axis=0), xy_m.max(axis=0)])
    return [float(value) for value in np.round(corners, 3).ravel()]


def _say(told: TextIO, event: Progress | Result) -> None:
    told.write(json.dumps(asdict(event), default=str) + "\n")


def _limit(limits: Json) -> None:
    os.nice(NICENESS)
    bound(resource.RLIMIT_DATA, limits["bytes"])
    bound(resource.RLIMIT_FSIZE, limits["bytes"])
    bound(resource.RLIMIT_CORE, 0)
