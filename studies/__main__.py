"""`python -m studies NAME OUT`: make the table or figure of a study."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import exit_code_of, print_rows, progress_bar, run_app
from elfslam.app.stopping import run_stoppable
from elfslam.line.feature import load_encoder
from elfslam.world.kinds import KINDS
from studies.catalogue import STUDIES, run_study


def study(
    name: Annotated[str, typer.Argument(help=", ".join(STUDIES))],
    out: Annotated[Path, typer.Argument(help="Folder for the table, as JSON and as CSV.")],
    data: Annotated[
        Path | None, typer.Option(envvar="ELFSLAM_DATA", help="Folder of real recordings.")
    ] = None,
    encoder: Annotated[list[str] | None, typer.Option(help="To be measured, repeatable.")] = None,
    kind: Annotated[
        str | None, typer.Option(help=f"Whose walks, in what life: {', '.join(KINDS)}.")
    ] = None,
    on: Annotated[
        str | None,
        typer.Option("--on", help="Who works: a number of processes, ray or ray://HOST:10001."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, not a table.")] = False,
) -> None:
    """Make the table of a study."""
    encoders = {Path(file).stem: load_encoder(file) for file in encoder or []}
    with progress_bar() as announce:
        table = run_study(name, out, data, announce, encoders=encoders, kind=kind, on=on)
    print_rows(table, title=f"Study: {name}", as_json=as_json)


def run(arguments: Sequence[str]) -> int:
    """The exit code of `python -m studies ARGUMENTS`."""
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command()(study)
    return exit_code_of(lambda: run_app(app, arguments or ["--help"], "python -m studies"))


if __name__ == "__main__":
    run_stoppable(lambda: run(sys.argv[1:]))
