"""elfslam card: what an encoder is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import print_rows, say
from elfslam.base.card import card_rows
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.text_files import read_json
from elfslam.cli.options import AsJson
from elfslam.data.folders import new_file
from elfslam.line.feature import OnnxEncoder, load_encoder, read_card


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


def write_measured(encoder: str, measured: Path, out: Path) -> None:
    """Write the encoder to `out` with the figures of a study's table on its card."""
    from elfslam.learn.onnx_files import with_metrics
    from studies.elf import metrics_of

    metrics = metrics_of(read_json(measured))
    known = load_encoder(encoder)
    content = known.content if isinstance(known, OnnxEncoder) else b""
    with new_file(out) as partial:
        partial.write_bytes(with_metrics(content, metrics))
    say(f"wrote {out}")
