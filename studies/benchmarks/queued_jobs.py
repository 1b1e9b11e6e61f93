"""Ten thousand mapping jobs in a server's queue, in a real PostgreSQL.

Usage, from the root of the project:

    python -m studies.benchmarks.queued_jobs FOLDER [--jobs 10000] [--walks 200] [--on 2]

Simulated walks of half a minute with a magnetometer, each the recording of many jobs, of fifty
users who take turns. The server is killed after a twentieth of the jobs and started again, the
process of a job after a fifth. FOLDER keeps the database and all data: the same command goes on
where it was cut off, and begins anew where it had ended. Reports are removed as they come; of ten
thousand maps they would fill 50 GB.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

from sqlalchemy import delete, func, select

from elfslam.app.console import print_rows, say
from elfslam.data.folders import new_file
from elfslam.data.recordings import write_recording
from elfslam.serve.jobs.queue import queue_job
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store import blobs
from elfslam.serve.store.database import (
    Job,
    JobKind,
    JobState,
    Map,
    MapFile,
    Recording,
    RecordingFile,
    RecordingState,
    User,
    new_id,
    reading,
    transaction,
)
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world, simulate
from studies.benchmarks.own_postgresql import own_postgresql
from studies.benchmarks.served import COMMAND
from studies.queue import FIRST_SEED, ROUNDS, WORLD, rss_of

USERS = 50
MILESTONES = (0.1, 0.5, 1.0)
LOOK_S = 1.0
PATIENCE_S = 900.0
OPEN = (JobState.QUEUED, JobState.RUNNING)
Row = dict[str, object]
Known = dict[str, object]


def main() -> None:
    """Print a row per milestone, and what became of the jobs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=10_000)
    parser.add_argument("--walks", type=int, default=200)
    parser.add_argument("--on", default="2")
    asked = parser.parse_args()
    folder = asked.folder.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    with own_postgresql(folder / "postgresql") as database:
        services = open_services(ServerSettings(folder / "data", database.url))
        kept = folder / "kept.json"
        if not kept.exists():
            fill(services, folder / "walks", asked.jobs, asked.walks)
            keep(kept, {"samples": [], "server_killed": False, "process_killed": False})
        known = json.loads(kept.read_text())
        while open_jobs(services):
            serve(services, asked, known, kept)
        print_rows(milestones(known, asked.jobs), title="The queue", as_json=False)
        print_rows([judged(services)], title="The jobs", as_json=False)
        services.engine.dispose()
    for item in ("data", "postgresql"):
        shutil.rmtree(folder / item)
    kept.unlink()


def fill(services: Services, walks: Path, jobs: int, count: int) -> None:
    """Users, recordings and a job for each of these."""
    made = [_stored(services, walks / str(number), number) for number in range(count)]
    with transaction(services.sessions) as session:
        users = [User(name=f"walker {n}", token_sha256=f"none {n}") for n in range(USERS)]
        session.add_all(users)
        session.flush()
        for job in range(jobs):
            user_id, recording_id = users[job % USERS].id, new_id()
            row = Recording(
                id=recording_id, user_id=user_id, name=f"walk {job}", state=RecordingState.READY
            )
            session.add(row)
            session.flush()
            for name, blob in made[job % count].items():
                told = {"sha256": blob.sha256, "size_bytes": blob.size_bytes}
                session.add(RecordingFile(recording_id=recording_id, name=name, **told))
            given = {"recording": recording_id, "by": ["magnetic"]}
            queue_job(session, user_id, JobKind.MAP, given)
            if job % 1000 == 0:
                say(f"{job} jobs queued")


def _stored(services: Services, walk: Path, number: int) -> dict[str, blobs.Blob]:
    if not walk.exists():
        sensors = (Sensor.MAGNETIC,)
        world, seed = load_world(WORLD), FIRST_SEED + number
        recording, _ = simulate(world, seed, rounds=ROUNDS, sound=False, sensors=sensors)
        write_recording(recording, walk)
    store = services.settings.blobs_folder
    with blobs.locked(store):
        return blobs.put_folder(store, walk)


def serve(services: Services, asked: argparse.Namespace, known: Known, kept: Path) -> None:
    """One server, until nothing is open or it was killed."""
    where = {"--data": services.settings.data_folder, "--database": services.settings.database_url,
             "--port": 0, "--on": asked.on}  # fmt: skip
    command = [*COMMAND, *(str(word) for option in where.items() for word in option)]
    with (kept.parent / "server.log").open("ab") as log:
        server = subprocess.Popen(command, stdout=log, stderr=log)
    samples = known["samples"]
    assert isinstance(samples, list)
    before_s = samples[-1][0] if samples else 0.0
    start_s = moved_s = time.monotonic()
    try:
        while server.poll() is None and (left := open_jobs(services)):
            done, now_s = asked.jobs - left, time.monotonic()
            if not samples or done > samples[-1][1]:
                moved_s = now_s
                samples.append([before_s + now_s - start_s, done, rss_of(server.pid)])
                keep(kept, known)
                say(f"{done} of {asked.jobs} jobs, server {samples[-1][2]:.0f} MiB")
            if now_s - moved_s > PATIENCE_S:
                raise SystemExit(f"no job ends; look at {kept.parent / 'server.log'}")
            if not known["process_killed"] and done >= asked.jobs / 5:
                known["process_killed"] = kill_a_process(services)
            if not known["server_killed"] and done >= asked.jobs / 20:
                known["server_killed"] = True
                server.kill()
            drop_reports(services)
            time.sleep(LOOK_S)
        end_s = before_s + time.monotonic() - start_s
        samples.append([end_s, asked.jobs - open_jobs(services), rss_of(server.pid)])
        drop_reports(services)
    finally:
        keep(kept, known)
        server.kill()
        server.wait()


def keep(kept: Path, known: Known) -> None:
    """Note what is known so far."""
    with new_file(kept) as partial:
        partial.write_text(json.dumps(known))


def open_jobs(services: Services) -> int:
    """How many jobs wait or run."""
    with reading(services.sessions) as session:
        return session.scalar(select(func.count()).where(Job.state.in_(OPEN))) or 0


def kill_a_process(services: Services) -> bool:
    """Kill a process that works on a job; whether there was one at this moment."""
    work = str(services.settings.work_folder)
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if os.readlink(entry / "fd" / "2").startswith(work):
                os.kill(int(entry.name), signal.SIGKILL)
                return True
        except OSError:
            continue
    return False


def drop_reports(services: Services) -> None:
    """Remove the reports that came since, from disk and database."""
    wanted = select(MapFile.map_id, MapFile.sha256).where(MapFile.name == "report.html")
    with transaction(services.sessions) as session:
        found = session.execute(wanted).all()
        maps = [row.map_id for row in found]
        session.execute(
            delete(MapFile).where(MapFile.map_id.in_(maps), MapFile.name == "report.html")
        )
    blobs.delete(services.settings.blobs_folder, [row.sha256 for row in found])


def milestones(known: Known, jobs: int) -> list[Row]:
    """Seconds, jobs per second and the server's memory at each milestone."""
    samples = known["samples"]
    assert isinstance(samples, list)
    alive = [sample for sample in samples if sample[2] > 0]
    rows: list[Row] = []
    before_s = before = 0.0
    for share in MILESTONES:
        t_s, done, rss_mib = next((each for each in alive if each[1] >= share * jobs), alive[-1])
        per_s = (done - before) / max(t_s - before_s, 1e-9)
        rows.append(
            {"jobs": done, "wall (s)": t_s, "jobs/s": per_s, "server (MiB)": round(rss_mib, 1)}
        )
        before_s, before = t_s, done
    return rows


def judged(services: Services) -> Row:
    """How the jobs ended, how often they were begun, and how long they waited."""
    with reading(services.sessions) as session:
        jobs = session.execute(
            select(Job.state, Job.attempts, Job.created_utc, Job.started_utc)
        ).all()
        sources = [source for each in session.scalars(select(Map.sources)) for source in each]
        recordings = session.scalar(select(func.count(Recording.id))) or 0
    waited_s = sorted((job.started_utc - job.created_utc).total_seconds() for job in jobs)
    return {
        "jobs": len(jobs),
        "done": sum(job.state == JobState.DONE for job in jobs),
        "failed": sum(job.state == JobState.FAILED for job in jobs),
        "begun again": sum(job.attempts > 1 for job in jobs),
        "maps": len(sources),
        "lost": recordings - len(set(sources)),
        "mapped twice": len(sources) - len(set(sources)),
        "left over": len(list(services.settings.work_folder.iterdir())),
        "waited (s), median": waited_s[len(waited_s) // 2],
        "longest": waited_s[-1],
    }


if __name__ == "__main__":
    main()
