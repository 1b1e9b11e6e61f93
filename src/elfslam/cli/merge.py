"""elfslam merge."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import print_rows, progress_bar, say
from elfslam.app.merge import merge_into
from elfslam.app.settings import Settings
from elfslam.base.parameters import load
from elfslam.cli.options import (
    AsJson,
    ParameterFile,
    Setting,
)


def merge_command(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="[MAP] RUN...", help="Oldest first, or a map and runs."),
    ],
    out: Annotated[Path, typer.Argument(help="The map folder.")],
    known_starts: Annotated[
        bool, typer.Option("--known-starts", help="All were mapped with --start in one frame.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an older map.")] = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
    as_json: AsJson = False,
) -> None:
    """Merge runs into one floor map, or add runs to a map that was merged before."""
    settings = load(Settings(), parameter_file, setting or [])
    with progress_bar() as announce:
        made = merge_into(out, runs, settings, announce, known_starts=known_starts, overwrite=force)
    if made.pairs:
        print_rows(made.pairs, title="How they met", as_json=as_json)
    for name, why in made.refused.items():
        say(f"not merged: {name}: {why}")
    say(f"{len(made.floor_map.sources)} walks in one map; look at {out / 'report.html'}")
