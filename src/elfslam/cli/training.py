"""elfslam pretrain and finetune."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import progress_bar, say
from elfslam.app.map import finetune_into
from elfslam.app.settings import Settings
from elfslam.base.parameters import load
from elfslam.cli.options import EncoderName, Force, ParameterFile, Seed, Setting


def pretrain_command(
    out: Annotated[Path, typer.Argument(metavar="OUT.onnx", help="Where the encoder goes.")],
    seed: Seed = 0,
    on: Annotated[
        str | None,
        typer.Option("--on", help="Who makes echoes: so many processes, ray or ray://HOST:10001."),
    ] = None,
    force: Force = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Train an encoder on simulated echoes; goes on after a kill."""
    from elfslam.app.simulated_training import pretrain_on_simulated_echoes

    known = load(Settings(), parameter_file, setting or []).pretrain
    with progress_bar() as announce:
        loss = pretrain_on_simulated_echoes(
            out, known, seed=seed, announce=announce, on=on, overwrite=force
        )
    say(f"wrote {out}; mean loss of the last tenth: {loss:.3f}")


def finetune_command(
    recording: Annotated[Path, typer.Argument(help="The walk to learn.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.onnx", help="Where the encoder goes.")],
    encoder: EncoderName = "compact",
    seed: Seed = 0,
    force: Force = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Fine-tune an encoder on one recording, without labels; kept as it is where that is better."""
    settings = load(Settings(), parameter_file, setting or [])
    with progress_bar() as announce:
        found = finetune_into(
            out, recording, encoder, settings, seed=seed, announce=announce, overwrite=force
        )
    say(f"wrote {out}; {found}")
