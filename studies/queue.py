"""Ten thousand recordings mapped by one command: how fast, how large it grows, what a kill costs.

The recordings are short simulated walks with a magnetometer, mapped by it: a tenth of a second of
work each, so that what is around the work shows. Walks are fewer than recordings: each is queued
under many names, and counts as another recording for each.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from elfslam.app.workers import Here
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.progress import Announce
from elfslam.data.facts import FACTS
from elfslam.data.folders import new_file, new_folder
from elfslam.data.recordings import MANIFEST, write_recording
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world, simulate
from studies.finding import Finding, Given
from studies.queue_table import Kept, queue_page, queue_rows

WORLD, ROUNDS, FIRST_SEED = "studio", 2, 100
PROCESSES = 2
COMMAND = (sys.executable, "-c", "from elfslam.cli import main; main()", "map")
LOOK_S = 0.5
"""How often the driver is looked at."""
PATIENCE_S = 600.0
"""A driver that finishes nothing for this long is given up."""


@dataclass(frozen=True)
class Asked:
    """How many recordings of how many walks, and after how many runs who is killed."""

    jobs: int
    walks: int
    kill_driver_at: int
    kill_worker_at: int


def measure_queue(given: Given, *, jobs: int = 10_000, walks: int = 200) -> Finding:
    """A row per milestone: seconds, runs per second and memory of the driver; then what was lost.

    The driver is killed after a twentieth of the runs and started again, one of its workers after
    a fifth. Everything lies beside `kept` until the end. Raises InputError
    for workers: the command that is measured has its own.
    """
    if given.kept is None or not isinstance(given.workers or Here(), Here):
        raise InputError(f"study queue: gives its work to {PROCESSES} processes; leave --on out")
    asked = Asked(jobs, walks, max(jobs // 20, 1), max(jobs // 5, 2))
    folder = given.kept.with_suffix(".work")
    recordings, runs = folder / "recordings", folder / "runs"
    _queue(folder / "walks", recordings, asked, given.announce)
    known = read_kept(given.kept)
    while (done := _names(runs)) < _names(recordings):
        _drive(recordings, runs, asked, known, given.kept, given.announce)
        if known.refused and len(_names(runs)) == len(done):
            raise NoAnswerError(f"study queue: the driver ended with {known.refused}; look at it")
    rows = queue_rows(known, jobs, _judged(recordings, runs, known, asked))
    shutil.rmtree(folder)
    return Finding(rows, queue_page(known, rows))


def read_kept(kept: Path) -> Kept:
    """What was measured before the study was cut off."""
    return Kept(**json.loads(kept.read_text())) if kept.exists() else Kept()


def _queue(walks: Path, recordings: Path, asked: Asked, announce: Announce) -> None:
    """The recordings: each walk under many names, its files linked, its name its own."""
    if recordings.exists():
        return
    for number in range(asked.walks):
        announce(f"{number} of {asked.walks} walks simulated", 0.0)
        if not (walks / str(number)).exists():
            world, seed = load_world(WORLD), FIRST_SEED + number
            sensors = (Sensor.MAGNETIC,)
            walk, _ = simulate(world, seed, rounds=ROUNDS, sound=False, sensors=sensors)
            write_recording(walk, walks / str(number))
    with new_folder(recordings) as partial:
        for job in range(asked.jobs):
            _link(walks / str(job % asked.walks), partial / f"walk-{job:05}")


def _link(walk: Path, recording: Path) -> None:
    recording.mkdir()
    for file in walk.iterdir():
        if file.name != MANIFEST:
            os.link(file, recording / file.name)
    manifest = json.loads((walk / MANIFEST).read_text())
    text = json.dumps({**manifest, "name": recording.name})
    (recording / MANIFEST).write_text(text)


def _drive(
    recordings: Path, runs: Path, asked: Asked, known: Kept, kept: Path, announce: Announce
) -> None:
    """One driver, until it ends or is killed."""
    command = [*COMMAND, str(recordings), str(runs), "--by", "magnetic", "--on", str(PROCESSES)]
    with (kept.parent / f"{kept.stem}.log").open("ab") as log:
        driver = subprocess.Popen(command, stdout=log, stderr=log)
    known.drivers += 1
    try:
        for done in _watched(driver, runs, known, kept):
            announce(f"{done} of {asked.jobs} runs", done / asked.jobs)
            if not known.workers_killed and done >= asked.kill_worker_at:
                known.workers_killed += _kill_a_worker(driver.pid)
            if not known.before_kill and done >= asked.kill_driver_at:
                known.before_kill = _written(runs)
                driver.kill()
        known.refused = max(driver.wait(), 0)
    finally:
        driver.kill()
        driver.wait()
        _keep(known, kept)


def _watched(driver: subprocess.Popen[bytes], runs: Path, known: Kept, kept: Path) -> Iterator[int]:
    """How many runs there are, every while; what the driver is like is noted."""
    before_s = known.samples[-1][1] if known.samples else 0.0
    start_s = moved_s = time.monotonic()
    most = -1
    while driver.poll() is None:
        done, now_s = len(_names(runs)), time.monotonic()
        if done > most:
            most, moved_s = done, now_s
            rss_mib = rss_of(driver.pid)
            known.samples.append([known.drivers, before_s + now_s - start_s, done, rss_mib])
            _keep(known, kept)
        if now_s - moved_s > PATIENCE_S:
            raise NoAnswerError(f"study queue: no run for {PATIENCE_S:.0f} s; look at {kept}")
        yield done
        time.sleep(LOOK_S)


def rss_of(process: int) -> float:
    """The resident memory of a process (MiB); 0 where it has ended."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0
    return int((status.partition("VmRSS:")[2].split() or ["0"])[0]) / 1024


def _keep(known: Kept, kept: Path) -> None:
    with new_file(kept) as partial:
        partial.write_text(json.dumps(asdict(known)) + "\n", encoding="utf-8")


def _names(folder: Path) -> set[str]:
    """Of what is whole in a folder."""
    if not folder.exists():
        return set()
    return {item.name for item in os.scandir(folder) if not item.name.startswith(".")}


def _written(runs: Path) -> dict[str, list[int]]:
    """Which file each run is, and when it was written."""
    told = {name: (runs / name / FACTS).stat() for name in _names(runs)}
    return {name: [each.st_ino, each.st_mtime_ns] for name, each in told.items()}


def _kill_a_worker(driver: int) -> int:
    """Kill one of the processes that a driver has map; how many that were."""
    for task in Path(f"/proc/{driver}/task").glob("*/children"):
        for child in task.read_text().split():
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                os.kill(int(child), signal.SIGKILL)
                return 1
    return 0


def _judged(recordings: Path, runs: Path, known: Kept, asked: Asked) -> dict[str, int]:
    """How many recordings have no run, were mapped again after a kill, and came out differently."""
    names, after = sorted(_names(recordings)), _written(runs)
    like: dict[int, set[bytes]] = {}
    for job, name in enumerate(names):
        if name in after:
            made = (runs / name / "trajectory.tum").read_bytes()
            like.setdefault(job % asked.walks, set()).add(made)
    return {
        "lost": len(names) - len(after),
        "done again": sum(after.get(name) != told for name, told in known.before_kill.items()),
        "unlike": sum(len(each) - 1 for each in like.values()),
    }
