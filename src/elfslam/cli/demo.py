"""elfslam demo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.compiling import compilation_announced
from elfslam.app.console import print_rows, progress_bar, say
from elfslam.app.demo import run_demo
from elfslam.app.map import line_only, versions
from elfslam.app.settings import Settings
from elfslam.base.parameters import load
from elfslam.cli.options import AsJson, EncoderName, ParameterFile, Setting
from elfslam.stages.feature import load_encoder


def demo(
    out: Annotated[Path, typer.Argument(help="Folder for recordings, map and reports.")],
    encoder: EncoderName = "compact",
    parameter_file: ParameterFile = None,
    setting: Setting = None,
    as_json: AsJson = False,
) -> None:
    """Map ten simulated surveys, locate others in them, write one of each with its reports."""
    parameters = load(Settings(), parameter_file, setting or [])
    with progress_bar() as announce, compilation_announced(announce):
        rows = run_demo(
            out, load_encoder(encoder), line_only(parameters), facts=versions(), announce=announce
        )
    print_rows(rows, title="Ten surveys of a room of 60 m2, and ten query walks", as_json=as_json)
    say(f"look at {out / 'score.html'}, {out / 'fixes.html'} and {out / 'run' / 'report.html'}")
