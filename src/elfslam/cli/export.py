"""elfslam export: a map for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import say
from elfslam.app.export import ExportContext, export
from elfslam.base.enums import Format
from elfslam.base.errors import ParameterError
from elfslam.cli.options import Force
from elfslam.data.geographic import parse_origin
from elfslam.data.imdf import read_place


def export_command(
    source: Annotated[Path, typer.Argument(metavar="RUN|MAP", help="What is to be exported.")],
    out: Annotated[Path, typer.Argument(help="The file to be written.")],
    to: Annotated[str, typer.Option(help=f"{', '.join(Format)}.")],
    origin: Annotated[
        str | None, typer.Option(help="LAT,LON[,BEARING_DEG] of the map's origin and x axis.")
    ] = None,
    place: Annotated[Path | None, typer.Option(help="TOML file about the venue, for imdf.")] = None,
    resolution: Annotated[
        float, typer.Option(help="Pixels of the ROS map, m.")
    ] = ExportContext.pixel_m,
    force: Force = False,
) -> None:
    """Write a run or a map in the format of other programs."""
    if to not in list(Format):
        raise ParameterError(f"--to: wanted {', '.join(Format)}, got {to!r}; choose one")
    told = ExportContext(
        None if origin is None else parse_origin(origin),
        None if place is None else read_place(place),
        resolution,
    )
    export(source, out, Format(to), told, overwrite=force)
    say(f"wrote {out}")
