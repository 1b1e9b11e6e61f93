"""elfslam parameters, card, pretrain and finetune: what can be set, and what encoders learn."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.card import write_measured
from elfslam.app.console import print_rows, progress_bar, say
from elfslam.app.map import finetune_into
from elfslam.app.settings import Settings
from elfslam.base.card import card_rows
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.parameters import load, rows
from elfslam.cli.options import AsJson, EncoderName, Force, ParameterFile, Seed, Setting
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
