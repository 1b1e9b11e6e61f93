"""elfslam score: runs and fixes against the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from elfslam.app.anchor import drawn_plan
from elfslam.app.console import print_rows, say
from elfslam.app.score_many import score_walks, truth_of
from elfslam.base.errors import InputError
from elfslam.cli.options import AsJson, Plan
from elfslam.data.atomic_files import replaced_file, settled
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
    run, truth, drawn = read_run(folder), truth_of(truth_path), drawn_plan(plan)
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
