"""Verbs of published floors: publish, withdraw, and list them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import print_rows, say
from elfslam.base.errors import ParameterError
from elfslam.cli.server import DATA_FOLDER, Database, DataFolder, FilesUrl
from elfslam.data.geographic import Origin, parse_origin

BuildingName = Annotated[str, typer.Option("--building", help="Its name.")]
Level = Annotated[int, typer.Option("--floor", help="0 is the ground floor.")]


def publish_command(
    source: Annotated[str, typer.Argument(metavar="MAP", help="Its folder, or its id here.")],
    building: BuildingName,
    floor: Level,
    at: Annotated[str, typer.Option(help="LAT,LON of the middle of the map, degrees.")],
    altitude: Annotated[float | None, typer.Option(help="Of the floor, m.")] = None,
    heard: Annotated[
        list[Path] | None, typer.Option(help="Recording whose Wi-Fi scans were made there.")
    ] = None,
    data: DataFolder = DATA_FOLDER,
    database: Database = "",
    files: FilesUrl = "",
) -> None:
    """Let phones find and fetch the map of a floor; published again it gets a new revision."""
    from elfslam.serve.buildings.indexes import index_floor
    from elfslam.serve.buildings.publishing import Spot, floor_of, publish
    from elfslam.serve.buildings.senses import WifiFindParameters
    from elfslam.serve.services import open_services
    from elfslam.serve.settings import ServerSettings
    from elfslam.serve.texts import plain_line

    try:
        name = plain_line(building)
    except ValueError as error:
        raise ParameterError(f"--building {building!r:.60}: {error}") from error
    lies = _place(at)
    spot = Spot(name, floor, lies.latitude_deg, lies.longitude_deg, altitude)
    services = open_services(ServerSettings(data.expanduser(), database, files_url=files))
    new = floor_of(services, source, spot, heard or [], WifiFindParameters())
    made = publish(services, new)
    heard_too = ", found by its echoes" if index_floor(services, made.map_id) else ""
    say(
        f"{name}, floor {floor}: map {made.map_id}, revision {made.revision}, {made.parts} parts "
        f"of {made.parts_bytes / 1e6:.2f} MB, {made.points} access points{heard_too}"
    )


def withdraw_command(
    building: BuildingName,
    floor: Level,
    data: DataFolder = DATA_FOLDER,
    database: Database = "",
    files: FilesUrl = "",
) -> None:
    """Take a floor back: no phone finds or fetches it any more."""
    from elfslam.serve.buildings.publishing import withdraw
    from elfslam.serve.services import open_services
    from elfslam.serve.settings import ServerSettings

    settings = ServerSettings(data.expanduser(), database, files_url=files)
    withdraw(open_services(settings), building, floor)
    say(f"{building}, floor {floor}: withdrawn")


def buildings_command(
    sweep: Annotated[
        bool, typer.Option("--sweep", help="Delete files that no floor names.")
    ] = False,
    index: Annotated[
        bool, typer.Option("--index", help="Build the index that finds floors by echoes.")
    ] = False,
    data: DataFolder = DATA_FOLDER,
    database: Database = "",
    files: FilesUrl = "",
) -> None:
    """List what is published."""
    from elfslam.serve.buildings import publishing
    from elfslam.serve.buildings.indexes import index_floors
    from elfslam.serve.buildings.publishing import published_rows
    from elfslam.serve.nearest import NearestParameters
    from elfslam.serve.services import open_services
    from elfslam.serve.settings import ServerSettings

    services = open_services(ServerSettings(data.expanduser(), database, files_url=files))
    print_rows(published_rows(services), title="Published floors", as_json=False)
    if index:
        floors, spots = index_floors(services, NearestParameters())
        say(f"indexed {spots} spots of {floors} floors")
    if sweep:
        say(f"swept {publishing.sweep(services)} files")


def _place(text: str) -> Origin:
    try:
        return parse_origin(text)
    except ParameterError as error:
        raise ParameterError(
            str(error).replace("--origin", "--at").replace("[,BEARING_DEG]", "")
        ) from error
