"""Verbs that train and describe encoders."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from elfslam.base.card import card_rows
from elfslam.base.errors import NoAnswerError
from elfslam.base.parameters import load, rows
from elfslam.cli.options import AsJson, EncoderName, ParameterFile, Seed, Setting
from elfslam.console import print_rows, progress_bar, say
from elfslam.line.feature import read_card
from elfslam.mapping import (
    finetune_into,
)
from elfslam.senses import Settings


def pretrain_command(
    out: Annotated[Path, typer.Argument(metavar="OUT.onnx", help="Where the encoder goes.")],
    seed: Seed = 0,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Train an encoder on simulated echoes; goes on after a kill."""
    from elfslam.studies.pretraining import pretrain_on_simulated_echoes

    known = load(Settings(), parameter_file, setting or []).pretrain
    with progress_bar() as announce:
        loss = pretrain_on_simulated_echoes(out, known, seed=seed, announce=announce)
    say(f"wrote {out}; mean loss of the last tenth: {loss:.3f}")


def finetune_command(
    recording: Annotated[Path, typer.Argument(help="The walk to learn.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.onnx", help="Where the encoder goes.")],
    encoder: EncoderName = "compact",
    seed: Seed = 0,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Fine-tune an encoder on one recording, without labels; kept as it is where that is better."""
    known = load(Settings(), parameter_file, setting or [])
    with progress_bar() as announce:
        found = finetune_into(out, recording, encoder, known, seed=seed, announce=announce)
    say(f"wrote {out}; {found}")


def card(
    encoder: Annotated[str, typer.Argument(help="compact or an ONNX file.")] = "compact",
    as_json: AsJson = False,
) -> None:
    """What an encoder is, and how to train it again: as its own file says."""
    known = read_card(encoder)
    if known is None:
        raise NoAnswerError(f"encoder {encoder}: carries no card, so how it was made is not known")
    print_rows(list(card_rows(known)), title=f"Encoder {encoder}", as_json=as_json)


def parameters(
    parameter_file: ParameterFile = None, setting: Setting = None, as_json: AsJson = False
) -> None:
    """Every parameter, its value, unit and meaning."""
    known = load(Settings(), parameter_file, setting or [])
    table = [asdict(row) for row in rows(known)]
    if not as_json:
        table = [{**row, "value": str(row["value"])} for row in table]
    print_rows(table, title="Parameters", as_json=as_json)
