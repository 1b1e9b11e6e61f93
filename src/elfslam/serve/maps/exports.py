"""A map in the formats of other programs, with what those ask for taken from a query."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import BaseModel, Field

from elfslam.base.enums import Format
from elfslam.base.errors import ElfslamError, ParameterError
from elfslam.data.geographic import parse_origin
from elfslam.data.imdf import Venue
from elfslam.data.map_files import ENCODER, FACTS
from elfslam.serve.jobs.tasks import Named, file_name
from elfslam.serve.maps.floors import level_of
from elfslam.serve.positions.values import MapOrigin
from elfslam.serve.problems import Problem
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import Map
from elfslam.serve.store.sending import ZIP, pieces, unfolded
from elfslam.serve.store.zips import packed
from elfslam.serve.texts import AsNumber, AsWhole, Line

if TYPE_CHECKING:
    from elfslam.app.export import ExportContext

BINARY = "application/octet-stream"
FILES = {
    Format.TUM: (".tum", "text/plain"),
    Format.G2O: (".g2o", "text/plain"),
    Format.ONNX: (".onnx", BINARY),
    Format.GEOJSON: (".geojson", "application/geo+json"),
    Format.IMDF: (".imdf.zip", ZIP),
    Format.ROS: (".yaml", ZIP),
    Format.PARQUET: (".parquet", BINARY),
}
"""How the file of a format ends, and what it is."""
HEAVY = ("echoes.npz", "features.npz")
"""Files of a run that no export reads; an hour's echoes fill much memory."""
OPTION = re.compile(r"--(\w+)")


class ExportOptions(BaseModel):
    """What no map knows and some formats ask for."""

    origin: str | None = Field(None, description="LAT,LON[,BEARING_DEG] of the map's origin")
    resolution_m: Annotated[float | None, AsNumber] = Field(
        None, description="side of a pixel of ros", allow_inf_nan=False
    )
    name: Line | None = Field(None, description="of the venue, for imdf; so are those below")
    category: Line | None = None
    address: Line | None = None
    locality: Line | None = None
    country: Line | None = None
    level: Line | None = None
    ordinal: Annotated[int | None, AsWhole] = Field(None, ge=-100, le=1000)
    level_short_name: Line | None = None
    province: Line | None = None
    postal_code: Line | None = None
    language: Line | None = None


def placed(asked: ExportOptions, found: Map, origin: MapOrigin | None) -> ExportOptions:
    """What was asked for, and beside it what is known of the venue and of where the map lies."""
    known = {"name": found.venue, "level": found.floor, "ordinal": level_of(found.floor)}
    if origin is not None:
        numbers = (origin.latitude_deg, origin.longitude_deg, origin.bearing_deg)
        known["origin"] = ",".join(f"{each!r}" for each in numbers)
    lacking = {name: told for name, told in known.items() if getattr(asked, name) is None}
    return asked.model_copy(update=lacking)


def formats_of(named: Named) -> list[Format]:
    """What a map can become that consists of these files."""
    lacking = {Format.G2O: FACTS not in named, Format.ONNX: ENCODER not in named}
    return [each for each in Format if not lacking.get(each, False)]


def exported(
    settings: ServerSettings, name: str, named: Named, to: Format, asked: ExportOptions
) -> tuple[Iterator[bytes], str, str]:
    """A map as the pieces of a file, that file's name and media type. Raises Problem 422."""
    from elfslam.app.export import export

    suffix, media_type = FILES[to]
    light = {file: sha256 for file, sha256 in named.items() if file not in HEAVY}
    with unfolded(settings, light) as folder:
        made = folder.parent / "made"
        made.mkdir()
        out = made / f"{file_name(name)}{suffix}"
        try:
            export(folder, out, to, told(asked, to))
        except ElfslamError as error:
            raise Problem(422, _in_words(error, folder, out, name)) from error
        files = {each.name: each for each in sorted(made.iterdir())}
        if len(files) > 1:
            return packed(files), f"{out.stem}.{to}.zip", ZIP
        return pieces(out.open("rb")), out.name, media_type


def told(asked: ExportOptions, to: Format) -> ExportContext:
    """What was asked for, as an export takes it. Raises ParameterError, naming what is missing."""
    from elfslam.app.export import ExportContext

    origin = None if asked.origin is None else parse_origin(asked.origin)
    pixel_m = ExportContext.pixel_m if asked.resolution_m is None else asked.resolution_m
    return ExportContext(origin, _place(asked) if to is Format.IMDF else None, pixel_m)


def _place(asked: ExportOptions) -> Venue:
    given = {each.name: getattr(asked, each.name) for each in fields(Venue)}
    missing = [
        each.name for each in fields(Venue) if each.default is MISSING and given[each.name] is None
    ]
    if missing:
        raise ParameterError(f"--{missing[0]}: imdf asks for {', '.join(missing)} of the venue")
    return Venue(**{name: value for name, value in given.items() if value is not None})


def _in_words(error: ElfslamError, folder: Path, out: Path, name: str) -> str:
    """The line of an error without folders of this server, options as parts of a query."""
    line = str(error).replace(str(out), out.name).replace(str(folder), name)
    return OPTION.sub(r"\1", line).replace("resolution:", "resolution_m:")
