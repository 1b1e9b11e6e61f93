"""elfslam merge."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from elfslam.app.console import print_rows, progress_bar, say
from elfslam.app.floor import merge_by_field
from elfslam.app.merge import merge_into
from elfslam.app.settings import Settings
from elfslam.base.enums import Modality, parse_modalities
from elfslam.base.parameters import load
from elfslam.cli.options import AsJson, Force, ParameterFile, Setting


def merge_command(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="[MAP] RUN...",
            help="Oldest first, or a map and runs; with --by recordings, or folders of them.",
        ),
    ],
    out: Annotated[Path, typer.Argument(help="The map folder.")],
    by: Annotated[
        str | None, typer.Option(help="wifi,magnetic: recordings, each from its declared start.")
    ] = None,
    known_starts: Annotated[
        bool, typer.Option("--known-starts", help="All lie in one frame, by --start or taps.")
    ] = False,
    force: Force = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
    as_json: AsJson = False,
) -> None:
    """Merge runs into one floor map, or add runs to a map that was merged before."""
    settings = load(Settings(), parameter_file, setting or [])
    if by is not None:
        _merge_by_field(out, runs, parse_modalities(by), settings, force=force)
        return
    with progress_bar() as announce:
        made = merge_into(out, runs, settings, announce, known_starts=known_starts, overwrite=force)
    if made.pairs:
        print_rows(made.pairs, title="How they met", as_json=as_json)
    for name, why in made.refused.items():
        say(f"not merged: {name}: {why}")
    say(f"{len(made.floor_map.sources)} walks in one map; look at {out / 'report.html'}")


def _merge_by_field(
    out: Path, paths: list[Path], by: tuple[Modality, ...], settings: Settings, *, force: bool
) -> None:
    with progress_bar() as announce:
        made = merge_by_field(out, paths, by, settings, announce, overwrite=force)
    for name, why in made.refused.items():
        say(f"not merged: {name}: {why}")
    turn, told = made.turn, np.isfinite(made.turn.sigma_rad)
    say(
        f"the floor lies {np.rad2deg(turn.turn_rad):.1f} +- {np.rad2deg(turn.sigma_rad):.1f} "
        "degrees from the compass, by the walks themselves"
        if told
        else "no two walks tell the angle of the floor: magnetic north is as declared"
    )
    say(
        f"{len(made.floor_map.sources)} walks in one map, {made.joined:.0%} of them corrected by "
        f"others; look at {out / 'report.html'}"
    )
