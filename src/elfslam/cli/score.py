"""elfslam score: runs and fixes against the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from elfslam.app.anchor import drawn_plan
from elfslam.app.console import print_rows, say
from elfslam.app.score_many import score_walks
from elfslam.base.errors import InputError
from elfslam.cli.options import AsJson, Plan
from elfslam.data.atomic_files import replaced_file, settled
from elfslam.data.map_files import FACTS, read_facts
from elfslam.data.position_files import read_fixes
from elfslam.data.runs import read_run
from elfslam.scoring.errors import ScoreRow, alignment_of, closure_scores, fix_scores, run_scores
from elfslam.scoring.report import write_report
from elfslam.scoring.truth import read_truth


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
    run, truth, drawn = read_run(folder), read_truth(truth_path), drawn_plan(plan)
    print_rows(run_scores(run, truth), title=f"{run.name}: errors (m)", as_json=as_json)
    if len(run.closures.i) and not as_json:
        print_rows(closure_scores(run, truth), title="Closures", as_json=False)
    with replaced_file(folder / "score.html") as page:
        write_report(page, run, facts=read_facts(folder), floor_plan=drawn, truth=truth)


def _score_fixes(
    file: Path, truth_path: Path, mapped: Path | None, map_truth: Path | None, *, as_json: bool
) -> None:
    if (mapped is None) != (map_truth is None):
        raise InputError("score: --map and --map-truth go together; give both or neither")
    move = np.zeros(3)
    if mapped is not None and map_truth is not None:
        move = alignment_of(read_run(mapped).trajectory, read_truth(map_truth))
    table: list[ScoreRow] = fix_scores(read_fixes(file), read_truth(truth_path), move)
    print_rows(table, title=f"{file.name}: errors (m)", as_json=as_json)
