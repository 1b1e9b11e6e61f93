"""elfslam superimpose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import progress_bar, say
from elfslam.app.merge import superimpose_into
from elfslam.app.settings import Settings
from elfslam.base.parameters import load
from elfslam.cli.options import Force, ParameterFile, Seed, Setting


def superimpose_command(
    source: Annotated[Path, typer.Argument(metavar="MAP", help="The map of several walks.")],
    out: Annotated[Path, typer.Argument(help="The map folder.")],
    learn: Annotated[
        list[Path] | None,
        typer.Option("--learn", metavar="RUN", help="A walk of MAP to learn from, repeatable."),
    ] = None,
    seed: Seed = 0,
    force: Force = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """One feature per spot for all headings; with --learn its encoder is trained for them."""
    settings = load(Settings(), parameter_file, setting or [])
    with progress_bar() as announce:
        made = superimpose_into(
            out, source, learn or [], settings, announce, seed=seed, overwrite=force
        )
    say(f"{len(made.xy_m)} spots for all headings; look at {out / 'report.html'}")
