"""Many recordings become many runs, by whoever works; what is done is not done again."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from elfslam.app.map import MapJob, mapped_run, refuse_taken, units_of
from elfslam.app.workers import SerialWorkers, Workers
from elfslam.base.errors import InputError, NoAnswerError, StoreError
from elfslam.base.values import Announce
from elfslam.data.facts import FACTS, read_facts
from elfslam.data.runs import write_run


def recordings_in(path: Path) -> list[Path]:
    """The recording at `path`, or those in the folder `path`."""
    if path.is_dir() and not (path / "recording.json").exists():
        inside = sorted(item.parent for item in path.glob("[!.]*/recording.json"))
        if inside:
            return inside
    return [path]


def map_many(
    out: Path,
    paths: list[Path],
    job: MapJob,
    announce: Announce,
    workers: Workers | None = None,
) -> dict[str, str]:
    """Map each recording into a folder of `out`; why not, by name, for those that cannot be.

    A run that lies there already and was made of the same recording in the same way stays, so
    that the same call goes on after a kill. No reports are written: `elfslam show` draws any of
    them. `workers` on other machines must see the same folders. Raises StoreError before the
    first where one of the folders holds anything else.
    """
    unit = units_of(job)
    waiting = [path for path in paths if not _is_done(path, out, unit)]
    for path in waiting:
        refuse_taken(out / path.name, job)
    refused: dict[str, str] = {}
    done = len(paths) - len(waiting)
    announce(f"{done} of {len(paths)} recordings", done / len(paths))
    for index, reason in (workers or SerialWorkers()).each(
        partial(_map_one, out=out, job=job), waiting
    ):
        done += 1
        announce(f"{done} of {len(paths)} recordings", done / len(paths))
        if reason:
            refused[waiting[index].name] = reason
    return {path.name: refused[path.name] for path in waiting if path.name in refused}


def _map_one(path: Path, out: Path, job: MapJob) -> str:
    """Why this recording has no run; empty where it has one now."""
    try:
        run, facts, content = mapped_run(path, job, lambda what, share: None)
    except (InputError, NoAnswerError) as error:
        return str(error)
    write_run(run, out / path.name, facts=facts, encoder=content, replace=job.overwrite)
    return ""


def _is_done(path: Path, out: Path, unit: Callable[[Path], str]) -> bool:
    if not (out / path.name / FACTS).exists():
        return False
    try:
        return read_facts(out / path.name).get("unit") == unit(path)
    except (InputError, StoreError, OSError):
        return False
