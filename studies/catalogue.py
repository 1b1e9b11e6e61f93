"""The studies by name, how one is run, and how all that are stale are."""

import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from elfslam.app.workers import Workers, open_workers
from elfslam.base.errors import InputError
from elfslam.base.values import Announce
from elfslam.stages.feature import Encoder
from elfslam.world.kinds import kind_named
from studies.cached import SCENARIOS, bound_cache
from studies.reached import changed_since
from studies.results import (
    RESULTS,
    Record,
    Result,
    commit_now,
    encoder_digest,
    read_results,
    stamped,
    write_results,
)
from studies.study import SampledError, Study, StudyContext

STUDIES = (
    "acoustic-odometry", "amounts", "attacks", "closures", "contention", "dead-reckoning",
    "displacement", "distinctness", "elf", "fidelity", "fix-thresholds", "floor-plan", "floors",
    "floors-by-wifi", "growing-map", "guided-matching", "laps", "live-footsteps", "localization",
    "localization-cost", "magnetic-left-out", "mall-fifths", "mall-floor", "many-mappers",
    "mapping", "merging", "noisy-phones", "paper", "paper-figures", "paper-summary", "passages",
    "phones", "pose-graphs", "real-rooms", "realism", "sensitivity", "sensors", "speech", "spots",
    "stability", "superimposition", "taps", "thresholds", "trace", "unknown-phone",
)  # fmt: skip
"""Each stands in the module of its name, as `STUDY`."""
CORES = 2
TIMES = "remake"
"""The result file of how long each study took."""


@dataclass(frozen=True)
class Choice:
    """What is asked of studies: where results go, what they read, who works, what is compared."""

    out: Path = RESULTS
    data: Path | None = None
    on: str | None = None
    fast: bool = False
    kind: str | None = None
    encoders: Mapping[str, Encoder] | None = None
    recording: Path | None = None


@dataclass(frozen=True)
class Stale:
    """A study whose results are missing, or older than its code or the encoder."""

    name: str
    kind: str | None
    why: str
    minutes: float


def study_named(name: str) -> Study:
    """A study, imported when it is asked for. Raises InputError where there is none."""
    if name not in STUDIES:
        raise InputError(f"study {name!r}: wanted {', '.join(STUDIES)}; no such study")
    found: Study = import_module(module_of(name)).STUDY
    return found


def module_of(name: str) -> str:
    """The module of a study."""
    return f"studies.{name.replace('-', '_')}"


def run_study(name: str, choice: Choice, announce: Announce) -> list[Result]:
    """Measure a study, and put what it found into its file, in place of the same scenario's.

    A long one keeps what is finished beside it until then, so that it goes on after a kill. Raises
    InputError for a study that does not exist, lacks what it needs, compares no encoders, is of no
    kind, or is too short to be shared out.
    """
    study = study_named(name)
    study.check(name, choice.data)
    told = _told(name, study, choice)
    kept = choice.out / f"{name}{'' if choice.kind is None else f'.{choice.kind}'}.partial"
    choice.out.mkdir(parents=True, exist_ok=True)
    begun_s = time.monotonic()
    with _workers_for(name, study, choice.on) as workers:
        records = list(study.measure(StudyContext(choice.data, announce, kept, workers), **told))
    commit, date = commit_now(), datetime.now(UTC).date().isoformat()
    results = list(stamped(name, records, commit, date))
    _put(choice.out / f"{name}.csv", results)
    took = Record(
        name, "time (min)", (time.monotonic() - begun_s) / 60, condition=choice.kind or ""
    )
    _put(choice.out / f"{TIMES}.csv", list(stamped(TIMES, [took], commit, date)))
    kept.unlink(missing_ok=True)
    bound_cache()
    return results


def sample_study(name: str, choice: Choice, count: int) -> dict[str, object]:
    """Processor time of some repeats of a long study, and what all of it takes on two cores.

    Raises InputError for a study that is not long, and as `run_study` does.
    """
    study = study_named(name)
    study.check(name, choice.data)
    if not study.long:
        raise InputError(f"study {name}: is short and has no repeats to sample; run it")
    try:
        study.measure(StudyContext(choice.data, sample=count), **_told(name, study, choice))
    except SampledError as found:
        runs = max(1, len(study.scenarios)) * found.repeats
        return {
            "study": name, "repeats": runs, "first (s)": round(found.first_s, 1),
            "again (s)": round(found.again_s, 1),
            "all, first (h)": round(found.first_s * runs / CORES / 3600, 2),
            "all, again (h)": round(found.again_s * runs / CORES / 3600, 2),
        }  # fmt: skip
    raise InputError(f"study {name}: shares out no repeats")


def run_stale(only: Collection[str], choice: Choice, announce: Announce) -> Iterator[Stale]:
    """Run every study that is stale, the cheapest first; gives each once it is done.

    What a run that was cut off had finished is not made again. Raises InputError before the first
    one runs where a study lacks what it needs.
    """
    waiting = stale_studies(only or STUDIES, choice)
    for each in waiting:
        study_named(each.name).check(each.name, choice.data)
    total = sum(each.minutes for each in waiting) or 1.0
    done = 0.0
    for number, each in enumerate(waiting, 1):
        start, share = done / total, each.minutes / total
        where = f"{number} of {len(waiting)}, {each.name}"

        def part(what: str, of: float | None, start: float = start, share: float = share,
                 where: str = where) -> None:  # fmt: skip
            announce(f"{where}: {what}", start + share * (of or 0.0))

        run_study(each.name, _for(each, choice), part)
        done += each.minutes
        yield each


def stale_studies(names: Collection[str], choice: Choice) -> list[Stale]:
    """Which studies, and which kinds of walk of theirs, are to be run again, the cheapest first."""
    found = sorted(_stale(names, choice), key=lambda each: each.minutes)
    waiting = [each for each in found if not study_named(each.name).counts]
    counts = [each for each in found if study_named(each.name).counts]
    if waiting and not counts:
        counts = [Stale(name, None, "others are", study_named(name).minutes)
                  for name in names if study_named(name).counts]  # fmt: skip
    return waiting + counts


def _stale(names: Collection[str], choice: Choice) -> list[Stale]:
    return [
        Stale(name, kind, why, study.minutes / max(1, len(study.scenarios)))
        for name in names
        for study in [study_named(name)]
        for kind in study.scenarios or (None,)
        for why in [_why_stale(name, kind, choice)]
        if why
    ]


def _why_stale(name: str, kind: str | None, choice: Choice) -> str:
    file = choice.out / f"{name}.csv"
    scenario = SCENARIOS.get(kind or "")
    rows = read_results(file) if file.exists() else []
    mine = [each for each in rows if scenario is None or each.scenario == scenario]
    if not mine:
        return "never run"
    commits = sorted({each.commit for each in mine})
    if len(commits) > 1:
        return f"of several commits: {', '.join(commits)}"
    if choice.fast:
        return "" if commits == [commit_now()] else f"of {commits[0]}"
    if mine[0].encoder != encoder_digest():
        return f"encoder {mine[0].encoder}, now {encoder_digest()}"
    changed = changed_since(commits[0].rstrip("+"), module_of(name))
    such = Path(changed[0]).name if changed else ""
    return f"{len(changed)} changed since {commits[0]}, such as {such}" if changed else ""


def _for(stale: Stale, choice: Choice) -> Choice:
    return Choice(choice.out, choice.data, choice.on if study_named(stale.name).long else None,
                  choice.fast, stale.kind)  # fmt: skip


def _told(name: str, study: Study, choice: Choice) -> dict[str, Any]:
    """What the study is told beside its context."""
    if choice.encoders and not study.encoders:
        raise InputError(f"study {name}: compares no encoders; leave --encoder out")
    if choice.kind is not None and choice.kind not in study.scenarios:
        wanted = ", ".join(study.scenarios) or "none"
        raise InputError(f"study {name}: kind {choice.kind!r}: wanted {wanted}")
    told: dict[str, Any] = dict(study.fast) if choice.fast else {}
    if study.scenarios:
        told["kind"] = kind_named(choice.kind or study.scenarios[0])
    if choice.recording is not None:
        if not study.recordings:
            raise InputError(f"study {name}: takes no recording; leave --recording out")
        told["recording"] = choice.recording
    return told | ({"encoders": choice.encoders} if choice.encoders else {})


def _put(file: Path, results: list[Result]) -> None:
    """Results into a file, in place of those of the same scenario, method where times are told."""
    key = (lambda each: (each.method, each.condition)) if file.stem == TIMES else _scenario
    replaced = {key(each) for each in results}
    older = read_results(file) if file.exists() else []
    write_results(file, [*(each for each in older if key(each) not in replaced), *results])


def _scenario(result: Result) -> object:
    return result.scenario


@contextmanager
def _workers_for(name: str, study: Study, on: str | None) -> Iterator[Workers]:
    if on is not None and not study.long:
        raise InputError(f"study {name}: is short and runs in this process; leave --on out")
    with open_workers(on) as workers:
        yield workers
