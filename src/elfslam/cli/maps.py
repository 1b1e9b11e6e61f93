"""elfslam anchor, export, way, show and score: what is done with a map."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from elfslam.app import anchor
from elfslam.app.console import print_rows, say
from elfslam.app.export import ExportContext, export
from elfslam.app.score_many import score_walks, truth_of
from elfslam.app.settings import Settings
from elfslam.app.show import show_into
from elfslam.app.way import find_way
from elfslam.base.arrays import F64
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.enums import Format
from elfslam.base.errors import InputError, NoAnswerError, ParameterError
from elfslam.base.parameters import load
from elfslam.cli.options import AsJson, Force, ParameterFile, Plan, Setting
from elfslam.data.atomic_files import replaced_file, settled
from elfslam.data.building_files import is_building
from elfslam.data.geographic import parse_origin
from elfslam.data.imdf import read_place
from elfslam.data.map_files import FACTS, read_facts
from elfslam.data.position_files import read_fixes
from elfslam.data.runs import read_run
from elfslam.scoring.errors import ScoreRow, alignment_of, closure_scores, fix_scores, run_scores
from elfslam.scoring.levels import (
    fix_level_scores,
    floor_scores,
    level_scores,
    level_shift,
    on_right_floor,
)
from elfslam.scoring.report import write_report
from elfslam.stages.floor_plan_alignment import AMBIGUOUS, NOWHERE, Placement
from elfslam.stages.ways import moves_of

TOLD_SIGMA = np.array([0.5, 0.5, 0.2])
"""How well people say where a walk begins and whereto, m, m, rad."""


def anchor_command(
    source: Annotated[Path, typer.Argument(metavar="RUN|MAP", help="What is to be placed.")],
    plan: Annotated[str, typer.Argument(help="plan.png:WIDTH_M or plan.geojson[:LEVEL].")],
    out: Annotated[Path, typer.Argument(help="The map folder, in the frame of the plan.")],
    start: Annotated[
        str | None, typer.Option(help="X,Y[,HEADING_RAD] of the first walk's start, m.")
    ] = None,
    follow: Annotated[
        bool, typer.Option("--follow", help="Bend the walk through the plan's passages.")
    ] = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Place a map on a floor plan: where its walks keep to accessible ground."""
    settings = load(Settings(), parameter_file, setting or [])
    told = _numbers(start)
    if is_building(source):
        if follow:
            raise ParameterError("--follow: a building's walk cannot be followed; leave it out")
        start_m = None if told is None else told[:2]
        placement = anchor.anchor_building_into(out, source, plan, settings.anchoring, start_m)
        _say_placed(placement, source, plan, out)
        return
    where = anchor.read_plan(plan)
    if follow:
        _follow(source, where, out, settings, told)
        return
    placement = anchor.anchor_into(
        out, source, where, settings.anchoring, None if told is None else told[:2]
    )
    _say_placed(placement, source, plan, out)
    if where.origin is not None:
        lies = f"{where.origin.latitude_deg},{where.origin.longitude_deg}"
        say(f"on the Earth: elfslam export {out} --origin {lies}")


def _say_placed(placement: Placement, source: Path, plan: str, out: Path) -> None:
    """Say where a map lies. Raises NoAnswerError where that is not sure."""
    if placement.status == NOWHERE:
        raise NoAnswerError(
            f"{source}: {placement.off_share:.0%} of it is off accessible ground wherever it is "
            f"placed on {plan}; is it that floor, and is the width right?"
        )
    if placement.status == AMBIGUOUS:
        raise NoAnswerError(
            f"{source}: fits {plan} in several ways, {_several(placement)}; say with --start "
            "where the first walk began"
        )
    say(f"wrote {out}: {_told(placement)}")


def _follow(
    source: Path, plan: anchor.Plan, out: Path, settings: Settings, told: F64 | None
) -> None:
    start = None
    if told is not None:
        if len(told) < 3:
            raise ParameterError(
                "--follow: wanted --start X,Y,HEADING_RAD or none; say the heading"
            )
        start = anchor.Start(told, np.diag(np.square(TOLD_SIGMA)))
    followed = anchor.follow_into(
        out, source, plan, (settings.anchoring, settings.map_matching), start
    )
    variance = np.trace(followed.covariance[:, :2, :2], axis1=1, axis2=2).mean() / 2
    say(f"wrote {out}: followed through the plan, sigma {np.sqrt(variance):.2f} m")


def _numbers(text: str | None) -> F64 | None:
    if text is None:
        return None
    try:
        told = np.array([float(cell) for cell in text.split(",")])
    except ValueError:
        told = np.empty(0)
    # NaN fails the comparison.
    if len(told) not in (2, 3) or not (np.abs(told) < FARTHEST_M).all():
        raise ParameterError(
            f"--start {text!r}: wanted X,Y in metres on the plan, such as 3.5,1, and perhaps the "
            "heading in radians"
        )
    return told


def _told(placement: Placement) -> str:
    x, y, heading = placement.plan_from_map
    sigma = np.sqrt(np.diag(placement.covariance))
    return (
        f"origin at {x:.2f}, {y:.2f} m, x axis at {np.rad2deg(heading):.1f} degrees, "
        f"scale {placement.scale:.3f}; sigma {np.hypot(*sigma[:2]) / np.sqrt(2):.2f} m and "
        f"{np.rad2deg(sigma[2]):.1f} degrees; probability {placement.shares[0]:.2f}"
    )


def _several(placement: Placement) -> str:
    poses = np.vstack([placement.plan_from_map, placement.others])
    return ", ".join(
        f"{share:.0%} at {x:.1f},{y:.1f} m turned {np.rad2deg(heading):.0f} degrees"
        for share, (x, y, heading) in zip(placement.shares[:4], poses[:4], strict=True)
    )


def export_command(
    source: Annotated[Path, typer.Argument(metavar="RUN|MAP", help="What is to be exported.")],
    out: Annotated[Path, typer.Argument(help="The file to be written.")],
    to: Annotated[str, typer.Option(help=f"{', '.join(Format)}.")],
    origin: Annotated[
        str | None, typer.Option(help="LAT,LON[,BEARING_DEG] of the map's origin and x axis.")
    ] = None,
    place: Annotated[Path | None, typer.Option(help="TOML file about the venue, for imdf.")] = None,
    resolution: Annotated[
        float, typer.Option(help="Pixels of the ROS map, m.")
    ] = ExportContext.pixel_m,
    force: Force = False,
) -> None:
    """Write a run or a map in the format of other programs."""
    if to not in list(Format):
        raise ParameterError(f"--to: wanted {', '.join(Format)}, got {to!r}; choose one")
    told = ExportContext(
        None if origin is None else parse_origin(origin),
        None if place is None else read_place(place),
        resolution,
    )
    export(source, out, Format(to), told, overwrite=force)
    say(f"wrote {out}")


def show(
    what: Annotated[
        str, typer.Argument(metavar="RUN|MAP|WORLD|PAGE.html", help="What to look at.")
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT.html", help="Where the page goes.")],
    force: Force = False,
) -> None:
    """Make one file of a run, a map, a world or a page with its script, to be sent around."""
    show_into(out, what, overwrite=force)
    say(f"look at {out}")


def way_command(
    source: Annotated[Path, typer.Argument(metavar="BUILDING|MAP", help="Where it leads through.")],
    start: Annotated[str, typer.Argument(metavar="FROM", help="NAME, LEVEL:NAME or LEVEL:X,Y.")],
    goal: Annotated[str, typer.Argument(metavar="TO", help="The same.")],
    without_stairs: Annotated[
        bool, typer.Option("--without-stairs", help="By lifts alone, no stairs or escalators.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Tell the quickest way between two places: along walked ground, from floor to floor."""
    route = find_way(source, start, goal, stairs=not without_stairs)
    rows = [
        {"floor": each.level, "after": each.after, "m": round(each.length_m, 1)}
        for each in moves_of(route)
    ]
    title = f"{route.length_m:.0f} m, about {route.duration_s:.0f} s"
    print_rows(rows, title=title, as_json=as_json)


def score(
    estimate: Annotated[Path, typer.Argument(metavar="RUN|FIXES", help="A run, runs, or a CSV.")],
    truth: Annotated[Path, typer.Argument(help="Truth file or recording, or a folder of them.")],
    mapped: Annotated[Path | None, typer.Option("--map", help="Run that the fixes lie in.")] = None,
    map_truth: Annotated[Path | None, typer.Option(help="Truth of that run.")] = None,
    plan: Plan = None,
    as_json: AsJson = False,
) -> None:
    """Compare a run, a folder of runs, or fixes with the truth; a run gets its score.html."""
    if estimate.suffix == ".csv":
        _score_fixes(estimate, truth, mapped, map_truth, as_json=as_json)
    elif not settled(estimate).is_dir():
        raise InputError(f"{estimate}: wanted a run folder or a CSV of fixes; check the path")
    elif (estimate / FACTS).exists():
        _score_run(estimate, truth, plan, as_json=as_json)
    else:
        table, left_out = score_walks(estimate, truth)
        print_rows(table, title=f"Runs in {estimate}", as_json=as_json)
        for name, reason in left_out.items():
            say(f"not scored: {name}: {reason}")


def _score_run(folder: Path, truth_path: Path, plan: str | None, *, as_json: bool) -> None:
    run, truth, drawn = read_run(folder), truth_of(truth_path), anchor.drawn_plan(plan)
    floors, levels = floor_scores(run, truth), level_scores(run, truth)
    besides = [*floors, *levels] if as_json else []
    rows = [*run_scores(run, truth), *besides]
    print_rows(rows, title=f"{run.name}: errors (m)", as_json=as_json)
    if floors and not as_json:
        print_rows(floors, title="Errors by floor, aligned as a whole (m)", as_json=False)
    if levels and not as_json:
        print_rows(levels, title="Floors", as_json=False)
    if len(run.closures.i) and not as_json:
        print_rows(closure_scores(run, truth), title="Closures", as_json=False)
    with replaced_file(folder / "score.html") as page:
        write_report(page, run, facts=read_facts(folder), floor_plan=drawn, truth=truth)


def _score_fixes(
    file: Path, truth_path: Path, mapped: Path | None, map_truth: Path | None, *, as_json: bool
) -> None:
    if (mapped is None) != (map_truth is None):
        raise InputError("score: --map and --map-truth go together; give both or neither")
    move, shift = np.zeros(3), 0
    if mapped is not None and map_truth is not None:
        run, known = read_run(mapped), truth_of(map_truth)
        move, shift = alignment_of(run.trajectory, known), level_shift(run, known)
    fixes, truth = read_fixes(file), truth_of(truth_path)
    levels = fix_level_scores(fixes, truth, shift)
    table: list[ScoreRow] = fix_scores(on_right_floor(fixes, truth, shift), truth, move)
    rows = [*table, *(levels if as_json else [])]
    on = " on the right floor" if levels else ""
    print_rows(rows, title=f"{file.name}: errors{on} (m)", as_json=as_json)
    if levels and not as_json:
        print_rows(levels, title="Floors", as_json=False)
