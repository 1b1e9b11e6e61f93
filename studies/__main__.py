"""`python -m studies NAME OUT`: make the table or figure of a study."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import print_rows, progress_bar
from elfslam.cli.options import AsJson, On
from elfslam.line.feature import load_encoder
from studies.catalogue import STUDIES, run_study


def study(
    name: Annotated[str, typer.Argument(help=", ".join(STUDIES))],
    out: Annotated[Path, typer.Argument(help="Folder for the table, as JSON and as CSV.")],
    data: Annotated[
        Path | None, typer.Option(envvar="ELFSLAM_DATA", help="Folder of real recordings.")
    ] = None,
    encoder: Annotated[list[str] | None, typer.Option(help="To be measured, repeatable.")] = None,
    on: On = None,
    as_json: AsJson = False,
) -> None:
    """Make the table of a study."""
    encoders = {Path(file).stem: load_encoder(file) for file in encoder or []}
    with progress_bar() as announce:
        table = run_study(name, out, data, announce, encoders=encoders, on=on)
    print_rows(table, title=f"Study: {name}", as_json=as_json)
