"""What works through the queue: one job after the other, each in a process of its own.

Those processes are where `open_executor` has them: on this machine, or on a cluster.

One server alone works on the jobs of a data folder: it holds the lock on a file there, and so do
the processes of its jobs. Whoever gets the lock knows that nobody works on anything, and queues
again what was interrupted.
"""

import shutil
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, cast

from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from elfslam.app.workers import WorkerDiedError, WorkersAwayError
from elfslam.base.errors import InputError, WorkerError
from elfslam.data.building_files import FLOORS
from elfslam.data.map_files import BY_TAPS, MISSING
from elfslam.serve.jobs import executors, queue, tasks
from elfslam.serve.problems import LOG, is_disk_full
from elfslam.serve.services import Services
from elfslam.serve.sharing.rights import Principal, Right, right_in
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob
from elfslam.serve.store.database import transaction
from elfslam.serve.store.opening import locked_now
from elfslam.serve.store.quota import drop_unnamed
from elfslam.serve.store.tables import JobFile, JobKind, Map, MapFacts, MapFile, Recording, new_id

LOCK = "jobs.lock"
FOLDERS = "job-"
"""How the names of jobs' folders begin."""
POLL_S = 1.0
"""Jobs that another server queued are found after this long."""
AWAY_S = 5.0
"""How long until a cluster that was away is asked for again."""
OF_FLOOR = ("level", "height_m", "passages")
"""What of a map's facts is of the floor of a building on which it lies."""
MISTAKE = "the server made a mistake over this job; its log says which"
LOG_CHARACTERS = 4000
T = TypeVar("T")


@dataclass(frozen=True)
class WorkerContext:
    """What the threads that work on jobs have in common."""

    services: Services
    stopping: threading.Event
    lock: int
    executor: executors.Executor
    away: threading.Event
    """Set where the workers of the executor are gone."""
    since_s: float
    """When the server began to work on jobs, by the monotonic clock."""


@contextmanager
def run_jobs(services: Services) -> Iterator[None]:
    """Work on jobs as long as the server runs. What is unfinished at the end is queued again."""
    if not services.settings.run_jobs:
        yield
        return
    stopping = threading.Event()
    thread = threading.Thread(target=_work_alone, args=(services, stopping), name="jobs")
    thread.start()
    try:
        yield
    finally:
        stopping.set()
        services.jobs_wanted.set()
        thread.join()


def _work_alone(services: Services, stopping: threading.Event) -> None:
    with (services.settings.data_folder / LOCK).open("w") as file:
        while not locked_now(file.fileno()):
            if stopping.wait(POLL_S):
                return
        for left in services.settings.work_folder.glob(f"{FOLDERS}*"):
            shutil.rmtree(left, ignore_errors=True)
        _patiently(stopping, partial(queue.queue_interrupted, services.sessions))
        since_s = time.monotonic()
        while not stopping.is_set():
            try:
                _work_there(services, stopping, file.fileno(), since_s)
            except (InputError, WorkerError) as error:
                LOG.warning("jobs wait: %s", error)
                stopping.wait(AWAY_S)


def _work_there(services: Services, stopping: threading.Event, lock: int, since_s: float) -> None:
    """Work until the server stops, or those who work are gone. Raises InputError, WorkerError."""
    settings = services.settings
    with executors.open_executor(settings.on, settings.job_workers) as executor:
        bench = WorkerContext(services, stopping, lock, executor, threading.Event(), since_s)
        workers = [threading.Thread(target=_work, args=(bench,)) for _ in range(executor.count)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        if bench.away.is_set():
            raise WorkersAwayError("the cluster is gone; asking for it again")


def _work(bench: WorkerContext) -> None:
    services = bench.services
    while not bench.stopping.is_set() and not bench.away.is_set():
        services.jobs_wanted.clear()
        begun = queue.begun_at_most(time.monotonic() - bench.since_s)
        held = _patiently(bench.stopping, partial(queue.claim, services.sessions, begun))
        if held is None:
            services.jobs_wanted.wait(POLL_S)
        else:
            _work_on(bench, held)


def _work_on(bench: WorkerContext, held: queue.Claim) -> None:
    services = bench.services
    folder = services.settings.work_folder / f"{FOLDERS}{held.job_id}-{held.token[:8]}"
    problem = None
    try:
        folder.mkdir()
        _attempt(bench, held, folder)
    except InputError as error:
        problem = str(error)
    except WorkerError as error:
        _put_back(bench, held, error)
    except Exception as error:
        LOG.exception("job %s failed", held.job_id)
        problem = executors.DISK_FULL if is_disk_full(error) else MISTAKE
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if problem is not None:
        _patiently(bench.stopping, partial(_fail, services, held, problem))


def _attempt(bench: WorkerContext, held: queue.Claim, folder: Path) -> None:
    services = bench.services
    tasks.lay_out(services, held, folder)
    longest_s = services.settings.limits.job_s
    result = _result(bench, held, bench.executor.work(folder, longest_s, bench.lock))
    if result is None:
        if bench.stopping.is_set():
            queue.give_back(services.sessions, held)
        return
    if result.problem is not None:
        _log(folder, held, result.problem)
    if result.died and held.attempt < bench.executor.tries:
        _patiently(bench.stopping, partial(queue.begin_again, services.sessions, held))
    else:
        _patiently(bench.stopping, partial(keep, services, held, folder, result))


def _result(
    bench: WorkerContext, held: queue.Claim, events: executors.Events
) -> executors.Result | None:
    """What came of a job, nothing where it was given up before; its progress is told meanwhile."""
    with closing(events):  # type: ignore[type-var]
        try:
            for event in events:
                if isinstance(event, executors.Result):
                    return event
                if not _goes_on(bench, held, event):
                    return None
        except WorkerDiedError as error:
            return executors.Result(None, str(error), died=True)
    raise WorkersAwayError("the cluster stopped in the middle; asking for it again")


def _put_back(bench: WorkerContext, held: queue.Claim, error: WorkerError) -> None:
    """Nobody there can do a job that is not at fault: it waits."""
    LOG.warning("job %s waits: %s", held.job_id, error)
    if isinstance(error, WorkersAwayError):
        bench.away.set()
    _patiently(bench.stopping, partial(queue.give_back, bench.services.sessions, held))
    bench.stopping.wait(POLL_S)


def _goes_on(bench: WorkerContext, held: queue.Claim, progress: executors.Progress | None) -> bool:
    """Pass progress on; whether to go on. A database that is away stops nobody."""
    if bench.stopping.is_set():
        return False
    sessions = bench.services.sessions
    try:
        return (
            queue.holds(sessions, held)
            if progress is None
            else queue.tell(sessions, held, progress)
        )
    except OperationalError as error:
        LOG.warning("job %s: %s", held.job_id, error)
        return True


def _fail(services: Services, held: queue.Claim, problem: str) -> None:
    with transaction(services.sessions) as session:
        queue.finish(session, held, {}, problem)


def _patiently(stopping: threading.Event, act: Callable[[], T]) -> T | None:
    """What `act` gives, tried again while the database is away; nothing if the server stops."""
    while True:
        try:
            return act()
        except OperationalError as error:
            LOG.warning("the database does not answer, trying again: %s", error)
        if stopping.wait(POLL_S):
            return None


def _log(folder: Path, held: queue.Claim, problem: str) -> None:
    """What the work's own process said of its failure, where it said anything."""
    file = folder / executors.LOG
    said = file.read_text(encoding="utf-8", errors="replace") if file.exists() else ""
    said = said[-LOG_CHARACTERS:]
    LOG.info("job %s: %s\n%s", held.job_id, problem, said.strip())


# --- what a job made becomes a map, or fixes: all files first, then all rows at once ---
#
# Whoever is killed in between leaves files that nobody names; the next start sweeps them away. A
# new map has the floor plan of the map whose frame it has.

JOINED = " + "
MOST_NAME = 120


def keep(services: Services, held: queue.Claim, folder: Path, result: executors.Result) -> bool:
    """Keep what lies in a job's folder and end the job; whether the claim still held.

    A job may fail and yet leave something: dead reckoning where no loop closed, say.
    """
    store = services.settings.blobs_folder
    made: dict[str, Blob] = {}
    with blobs.locked(store):
        if result.facts is not None:
            made = blobs.put_folder(store, folder / executors.OUT)
        with transaction(services.sessions) as session:
            maps = _maps_of(held, result.facts, made)
            gave = _gave(held, result.facts, [each.id for each in maps])
            kept = queue.finish(session, held, gave, result.problem)
            for each in maps if kept else ():
                _add_map(session, held, each)
            if kept and not maps:
                session.add_all(
                    JobFile(job_id=held.job_id, name=name, **asdict(blob))
                    for name, blob in made.items()
                )
    if not kept:
        drop_unnamed(services, [blob.sha256 for blob in made.values()])
    return kept


@dataclass(frozen=True)
class NewMap:
    """A map that a job made; `floor` is the name of its level where it lies in a building."""

    id: str
    facts: MapFacts
    files: dict[str, Blob]
    floor: str | None = None


def _maps_of(
    held: queue.Claim, facts: dict[str, Any] | None, made: dict[str, Blob]
) -> list[NewMap]:
    """The maps among what a job made: one, or one a floor, whose frame is that of the lowest."""
    if facts is None or held.kind is JobKind.LOCATE:
        return []
    if FLOORS not in facts:
        return [NewMap(new_id(), cast(MapFacts, facts), made)]
    common = {name: value for name, value in facts.items() if name != FLOORS}
    frame, maps = new_id(), list[NewMap]()
    for told in facts[FLOORS]:
        inside, level = f"{FLOORS}/{told['level']}/", str(told["level"])
        files = {
            name[len(inside) :]: blob for name, blob in made.items() if name.startswith(inside)
        }
        report = {name: blob for name, blob in made.items() if name.endswith((".html", ".js"))}
        its = cast(MapFacts, {**common, **told, "frame": frame})
        maps.append(NewMap(new_id() if maps else frame, its, report | files, level))
    return maps


def _gave(held: queue.Claim, facts: dict[str, Any] | None, map_ids: list[str]) -> dict[str, Any]:
    """What the job says that it gave."""
    if facts is None:
        return {}
    if held.kind is JobKind.LOCATE:
        return {"fixes": held.job_id, **facts}
    lacked = {MISSING: facts[MISSING]} if facts.get(MISSING) else {}
    others = {FLOORS: map_ids[1:]} if len(map_ids) > 1 else {}
    return {"map": map_ids[0], **others, **lacked}


def _add_map(session: Session, held: queue.Claim, new: NewMap) -> None:
    kind = tasks.RUN if held.kind is JobKind.MAP else tasks.FLOOR
    told = _origin(session, held)
    if new.floor is not None:
        told |= {"venue": told["name"], "floor": new.floor}
    added = Map(id=new.id, user_id=held.user_id, kind=kind, facts=new.facts, **told)
    session.add(added)
    session.flush()
    if held.kind is JobKind.MAP:
        recording = session.get_one(Recording, held.given["recording"])
        lay_on_tapped_plan(session, added, recording, new.facts)
    else:
        lay_on_plan_of_first(session, added, tasks.maps_to_merge(session, held), new.facts)
    session.add_all(
        MapFile(map_id=new.id, name=name, **asdict(blob)) for name, blob in new.files.items()
    )


def _origin(session: Session, held: queue.Claim) -> dict[str, Any]:
    """The name of a map, the recordings that it came from, each once, and where it lies.

    What a claim works on is there as long as the claim holds: deleting it ends the job.
    """
    if held.kind is JobKind.MAP:
        recording = session.get_one(Recording, held.given["recording"])
        return {"name": recording.name, "sources": [recording.id]}
    maps = tasks.maps_to_merge(session, held)
    named = held.given.get("name") or JOINED.join(each.name for each in maps)[:MOST_NAME]
    sources = list(dict.fromkeys(source for each in maps for source in each.sources))
    return {"name": named, "sources": sources, **_common_place(maps)}


def _common_place(maps: Sequence[Map]) -> dict[str, str | None]:
    """The venue and floor of maps that all lie there."""
    venues, floors = {each.venue for each in maps}, {(each.venue, each.floor) for each in maps}
    venue = venues.pop() if len(venues) == 1 else None
    return {"venue": venue, "floor": floors.pop()[1] if len(floors) == 1 else None}


def lay_on_tapped_plan(session: Session, made: Map, recording: Recording, facts: MapFacts) -> None:
    """Give the map of a walk the plan, venue and floor of the map on which its walker tapped.

    Both have one frame, where mapping found the walk there. Nothing is given where that map is
    gone, or where its walker may no longer look at it.
    """
    if facts.get("heading") != BY_TAPS:
        return
    tapped = session.get(Map, recording.facts.get("tapped_on", ""))
    if tapped is None or right_in(session, Principal(made.user_id), tapped) < Right.READ:
        return
    made.venue, made.floor = tapped.venue, tapped.floor
    _lay(session, made, tapped)


def lay_on_plan_of_first(session: Session, made: Map, maps: Sequence[Map], facts: MapFacts) -> None:
    """Give a merged map the plan and floor of the map whose frame it has, and note that frame.

    That is the merged one among them, else the oldest walk that was not refused.
    """
    inside = [each for each in maps if tasks.name_of(each) not in facts.get("refused", {})]
    inside.sort(key=lambda each: each.kind != tasks.FLOOR)
    if inside:
        lies = {name: told for name, told in inside[0].facts.items() if name in OF_FLOOR}
        its = {**made.facts, **lies, "frame": tasks.frame_of(session, inside[0])}
        made.facts = cast(MapFacts, its)
        _lay(session, made, inside[0])


def _lay(session: Session, made: Map, planned: Map) -> None:
    plan = session.get(MapFile, (planned.id, tasks.FLOOR_PLAN))
    if plan is None:
        return
    made.floor_plan = planned.floor_plan
    blob = asdict(Blob(plan.sha256, plan.size_bytes))
    session.add(MapFile(map_id=made.id, name=plan.name, **blob))
