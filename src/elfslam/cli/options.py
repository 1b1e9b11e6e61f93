"""Options that several verbs share, and what they say of many recordings."""

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import say
from elfslam.base.errors import InputError, NoAnswerError

ParameterFile = Annotated[
    Path | None, typer.Option("--parameters", help="TOML file of parameters.")
]
Setting = Annotated[list[str] | None, typer.Option("--set", help="group.name=value, repeatable.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Same seed, same bytes.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
EncoderName = Annotated[str, typer.Option("--encoder", help="compact, spectral or an ONNX file.")]
On = Annotated[
    str | None,
    typer.Option("--on", help="Who works: a number of processes, ray or ray://HOST:10001."),
]
Force = Annotated[bool, typer.Option("--force", help="Replace an older result.")]
Plan = Annotated[
    str | None,
    typer.Option(
        "--floor-plan", help="Drawn below: plan.png:WIDTH_M, plan.geojson[:LEVEL] or a world."
    ),
]


def refuse_if_none(done: str, source: Path, refused: dict[str, str], count: int) -> None:
    """Raise InputError where something was refused and nothing done."""
    if refused and not count:
        reason = next(iter(refused.values()))
        raise InputError(f"{source}: none of {len(refused)} could be {done}; {reason}")


def say_refused(done: str, refused: dict[str, str]) -> None:
    """Say what was refused and why; raise NoAnswerError where something was."""
    for name, reason in refused.items():
        say(f"not {done}: {name}: {reason}")
    if refused:
        raise NoAnswerError(f"{len(refused)} could not be {done}, see above")
