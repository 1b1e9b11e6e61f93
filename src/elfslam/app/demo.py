"""The demonstration: map ten surveys, locate others in the maps, show one of each."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from elfslam.app.anchor import floor_plan
from elfslam.app.map import write_reported_run
from elfslam.base.arrays import F64
from elfslam.base.enums import Mode
from elfslam.base.parameters import as_dict, digest
from elfslam.base.values import Fixes, FixStatus, Recording, Run, Truth
from elfslam.data.atomic_files import new_file, refuse_occupied
from elfslam.data.position_files import write_fixes
from elfslam.data.recordings import write_recording
from elfslam.scoring.errors import (
    AS_DECLARED,
    Alignment,
    alignment_of,
    fix_distances,
    interval,
    methods,
    placed_errors,
    position_errors,
    summarise,
)
from elfslam.scoring.report import write_fix_report, write_report
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import locate, map_by_echoes
from elfslam.stages.feature import Encoder, OnnxEncoder
from elfslam.world.kinds import PEOPLE, SURVEYOR, Kind
from elfslam.world.simulate import simulate
from elfslam.world.world_file import World, load_world

WORLD = "living_room"
SEEDS = tuple(range(10))
MAPPING_ROUNDS = 5
LOCATING_ROUNDS = 2
LOCATING_SEED = 1000
"""Added to a seed: the walk to be located is another person's."""
LOCATED = (
    (SURVEYOR, Mode.ONE_SHOT, "same line, one-shot"),
    (SURVEYOR, Mode.TRACK, "same line, tracker"),
    (PEOPLE, Mode.TRACK, "people, tracker"),
)
"""Who is located how: on another day with another phone, people on ways that cross the line."""

FILES = ("score.html", "fixes.csv", "fixes.html")
"""Written beside the folders of both walks and of the run."""
Row = dict[str, object]


@dataclass
class Collected:
    """Errors in metres of each walk, by method and alignment; fixes by status."""

    mapping: dict[tuple[str, str], list[F64]] = field(default_factory=dict)
    fixes: dict[str, list[F64]] = field(default_factory=dict)
    queries: dict[str, int] = field(default_factory=dict)


def run_demo(
    out: Path,
    encoder: Encoder,
    parameters: Parameters,
    *,
    facts: Mapping[str, object],
    announce: Callable[[str, float | None], None],
    seeds: Sequence[int] = SEEDS,
) -> list[Row]:
    """Write the first walk's recording, run, fixes and reports to `out`; give a row a figure.

    First the errors of dead reckoning and SLAM over all seeds, then of who is located how, with
    the share of queries that got a fix. `announce` hears what is being done and the share done.
    """
    for name in ("walk", "stranger", "run"):
        refuse_occupied(out / name, None)
    with ExitStack() as stack:
        files = [stack.enter_context(new_file(out / name)) for name in FILES]
        collected = _collected(out, files, encoder, parameters, facts, announce, seeds)
    announce("done", 1.0)
    return _rows(collected)


def _collected(
    out: Path,
    files: Sequence[Path],
    encoder: Encoder,
    parameters: Parameters,
    facts: Mapping[str, object],
    announce: Callable[[str, float | None], None],
    seeds: Sequence[int],
) -> Collected:
    world, collected = load_world(WORLD), Collected()
    for count, seed in enumerate(seeds):
        announce(f"walk {seed}: simulating, mapping and locating", count / len(seeds))
        walk = _declared(*_walked(world, seed, SURVEYOR))
        run = map_by_echoes(walk[0], encoder, parameters)
        assert run.floor_map is not None
        _collect_errors(collected, run, walk[1])
        others = {
            kind.name: _asked(world, seed + LOCATING_SEED, kind) for kind in (SURVEYOR, PEOPLE)
        }
        shown: list[Fixes] = []
        for kind, mode, name in LOCATED:
            recording, truth = others[kind.name]
            fixes = locate(recording, run.floor_map, encoder, parameters, mode=mode)
            _collect_fixes(collected, name, fixes, truth, alignment_of(run.trajectory, walk[1]))
            shown.append(fixes)
        if seed == seeds[0]:
            content = encoder.content if isinstance(encoder, OnnxEncoder) else None
            described = {
                **facts,
                "parameters": as_dict(parameters),
                "parameters_digest": digest(parameters),
            }
            stranger = others[SURVEYOR.name]
            _write_example(out, files, world, walk, stranger, run, shown[0], described, content)
    return collected


def _walked(world: World, seed: int, kind: Kind) -> tuple[Recording, Truth]:
    return simulate(
        world, seed, rounds=MAPPING_ROUNDS, walker=kind.walker,
        circumstances=kind.mapping(world.room),
    )  # fmt: skip


def _asked(world: World, seed: int, kind: Kind) -> tuple[Recording, Truth]:
    return simulate(
        kind.asking_place(world, seed), seed, rounds=LOCATING_ROUNDS, walker=kind.walker,
        circumstances=kind.asking(world.room),
    )  # fmt: skip


def _declared(recording: Recording, truth: Truth) -> tuple[Recording, Truth]:
    """The walker says where the walk starts and whereto, as in the paper."""
    x_m, y_m, heading_rad = truth.world_from_body[0].tolist()
    return replace(recording, start_pose=(x_m, y_m, heading_rad)), truth


def _collect_errors(collected: Collected, run: Run, truth: Truth) -> None:
    for method, (t_s, poses) in methods(run).items():
        declared = placed_errors(t_s, poses, truth, AS_DECLARED)
        aligned = position_errors(t_s, poses, truth, Alignment.ALIGNED)
        collected.mapping.setdefault((method, "declared start"), []).append(declared)
        collected.mapping.setdefault((method, Alignment.ALIGNED.value), []).append(aligned)


def _collect_fixes(
    collected: Collected, name: str, fixes: Fixes, truth: Truth, world_from_map: F64
) -> None:
    status, errors = fix_distances(fixes, truth, world_from_map)
    collected.fixes.setdefault(name, []).append(errors[status == FixStatus.OK])
    collected.queries[name] = collected.queries.get(name, 0) + len(status)


def _rows(collected: Collected) -> list[Row]:
    mapped = [
        row
        for (method, alignment), walks in collected.mapping.items()
        for row in _statistics({"method": method, "condition": alignment}, walks)
    ]
    located = [
        row
        for name, walks in collected.fixes.items()
        for of in [{"method": name, "condition": "located"}]
        for row in [*_statistics(of, walks), _answered(of, walks, collected.queries[name])]
    ]
    return mapped + located


def _statistics(of: Mapping[str, object], walks: list[F64]) -> list[Row]:
    """Median, mean and third quartile over all footsteps, with 95 % by resampling walks."""
    found = summarise(np.concatenate(walks))
    values: dict[str, tuple[float, Callable[[F64], float]]] = {
        "median error (m)": (found.median_m, lambda errors: float(np.median(errors))),
        "mean error (m)": (found.mean_m, lambda errors: float(np.mean(errors))),
        "third quartile (m)": (found.q3_m, lambda errors: float(np.quantile(errors, 0.75))),
    }
    rows = []
    for metric, (value, statistic) in values.items():
        low, high = interval(walks, statistic, np.random.default_rng(0))
        rows.append({**of, "metric": metric, "value": value, "low": low, "high": high})
    return rows


def _answered(of: Mapping[str, object], walks: list[F64], queries: int) -> Row:
    share = sum(map(len, walks)) / queries
    return {**of, "metric": "answered", "value": share, "low": None, "high": None}


def _write_example(
    out: Path,
    files: Sequence[Path],
    world: World,
    walk: tuple[Recording, Truth],
    stranger: tuple[Recording, Truth],
    run: Run,
    fixes: Fixes,
    facts: Mapping[str, object],
    encoder: bytes | None,
) -> None:
    score_page, fixes_file, fixes_page = files
    plan = floor_plan(world.room)
    write_recording(walk[0], out / "walk", truth=walk[1])
    write_recording(stranger[0], out / "stranger", truth=stranger[1])
    write_reported_run(run, out / "run", facts=facts, encoder=encoder)
    write_report(score_page, run, facts=facts, floor_plan=plan, truth=walk[1])
    write_fixes(fixes, fixes_file)
    assert run.floor_map is not None
    move = alignment_of(run.trajectory, walk[1])
    write_fix_report(fixes_page, run.floor_map, fixes, stranger[1], world_from_map=move)
