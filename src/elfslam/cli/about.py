"""elfslam parameters and card: what can be set, and what an encoder is."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.card import write_measured
from elfslam.app.console import print_rows, say
from elfslam.app.settings import Settings
from elfslam.base.card import card_rows
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.parameters import load, rows
from elfslam.cli.options import AsJson, Force, ParameterFile, Setting
from elfslam.stages.feature import read_card


def parameters(
    parameter_file: ParameterFile = None, setting: Setting = None, as_json: AsJson = False
) -> None:
    """Every parameter, its value, unit and meaning."""
    settings = load(Settings(), parameter_file, setting or [])
    table = [asdict(row) for row in rows(settings)]
    if not as_json:
        table = [{**row, "value": str(row["value"])} for row in table]
    print_rows(table, title="Parameters", as_json=as_json)


def card(
    encoder: Annotated[str, typer.Argument(help="compact or an ONNX file.")] = "compact",
    measured: Annotated[
        Path | None,
        typer.Option(metavar="ELF.csv", help="Results of the study elf about it, for its card."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="OUT.onnx", help="Where it goes with these figures.")
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """What an encoder is, and how to train it again: as its own file says."""
    if (measured is None) != (out is None):
        raise InputError("card: --measured and --out go together; name both or neither")
    if measured is not None and out is not None:
        write_measured(encoder, measured, out, overwrite=force)
        say(f"wrote {out}")
        encoder = str(out)
    known = read_card(encoder)
    if known is None:
        raise NoAnswerError(f"encoder {encoder}: carries no card, so how it was made is not known")
    print_rows(list(card_rows(known)), title=f"Encoder {encoder}", as_json=as_json)
