"""Verbs that train and describe encoders."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from elfslam.base.card import card_rows
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.parameters import load, rows
from elfslam.base.text_files import read_json
from elfslam.cli.options import AsJson, EncoderName, ParameterFile, Seed, Setting
from elfslam.console import print_rows, progress_bar, say
from elfslam.data.folders import new_file
from elfslam.line.feature import OnnxEncoder, load_encoder, read_card
from elfslam.mapping import (
    finetune_into,
)
from elfslam.senses import Settings


def pretrain_command(
    out: Annotated[Path, typer.Argument(metavar="OUT.onnx", help="Where the encoder goes.")],
    seed: Seed = 0,
    on: Annotated[
        str | None,
        typer.Option("--on", help="Who makes echoes: so many processes, ray or ray://HOST:10001."),
    ] = None,
    trainers: Annotated[
        int, typer.Option("--trainers", help="Processes that train; one that dies starts again.")
    ] = 1,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Train an encoder on simulated echoes; goes on after a kill."""
    from elfslam.studies.pretraining import pretrain_on_simulated_echoes

    known = load(Settings(), parameter_file, setting or []).pretrain
    with progress_bar() as announce:
        loss = pretrain_on_simulated_echoes(
            out, known, seed=seed, announce=announce, on=on, trainers=trainers
        )
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
    measured: Annotated[
        Path | None,
        typer.Option(metavar="ELF.json", help="Rows of `study elf` about it, for its card."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="OUT.onnx", help="Where it goes with these figures.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """What an encoder is, and how to train it again: as its own file says."""
    if (measured is None) != (out is None):
        raise InputError("card: --measured and --out go together; name both or neither")
    if measured is not None and out is not None:
        write_measured(encoder, measured, out)
        encoder = str(out)
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


def write_measured(encoder: str, measured: Path, out: Path) -> None:
    """Write the encoder to `out` with the figures of a study's table on its card."""
    from elfslam.learn.export import with_metrics
    from elfslam.studies.elf import metrics_of

    metrics = metrics_of(read_json(measured))
    known = load_encoder(encoder)
    content = known.content if isinstance(known, OnnxEncoder) else b""
    with new_file(out) as partial:
        partial.write_bytes(with_metrics(content, metrics))
    say(f"wrote {out}")
