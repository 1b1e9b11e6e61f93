"""Verbs of the server: serve, invite somebody, and the floors that are published."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from elfslam.app.console import print_line, print_rows, say
from elfslam.app.workers import check_on
from elfslam.base.errors import InputError, ParameterError
from elfslam.cli.options import On
from elfslam.data.geographic import Origin, parse_origin

if TYPE_CHECKING:
    from elfslam.serve.positions.mqtt import Broker
    from elfslam.serve.services import Services
    from elfslam.serve.settings import Limits

DATA_FOLDER = Path("~/.elfslam")
MOST_DAYS = 3650
DataFolder = Annotated[Path, typer.Option("--data", help="Where all data of the server lie.")]
Database = Annotated[str, typer.Option(help="SQLAlchemy's URL; default: SQLite in the folder.")]
FilesUrl = Annotated[
    str, typer.Option("--files", help="fsspec URL of published maps; default: in the folder.")
]

Mqtt = Annotated[
    str, typer.Option(help="Publish positions: mqtt[s]://[USER:PASSWORD@]HOST[:PORT]/PREFIX.")
]
Credentials = Annotated[
    Path | None, typer.Option(help="A file of one line, USER:PASSWORD, for the broker.")
]
Authority = Annotated[
    Path | None, typer.Option(help="PEM file of whom to trust at mqtts://; else the system's.")
]
PositionDays = Annotated[
    float, typer.Option(help="How many days walkers' positions are kept; 0: not at all.")
]
LocalWebhooks = Annotated[
    bool, typer.Option("--local-webhooks", help="Post to this machine and its networks, too.")
]


def serve_command(
    data: DataFolder = DATA_FOLDER,
    host: Annotated[str | None, typer.Option(help="Default: the LAN address and loopback.")] = None,
    address: Annotated[
        str | None,
        typer.Option(help="Where other devices reach it, for the QR code: HOST or a URL."),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65_535, help="0 chooses a free one.")] = 8443,
    database: Database = "",
    jobs: Annotated[bool, typer.Option(help="Map what is uploaded.")] = True,
    on: On = None,
    http: Annotated[bool, typer.Option("--http", help="Plain HTTP, on loopback alone.")] = False,
    allow_public: Annotated[
        bool, typer.Option("--allow-public", help="Answer beyond the local network.")
    ] = False,
    new_token: Annotated[
        bool, typer.Option("--new-token", help="The owner's devices pair again.")
    ] = False,
    new_key: Annotated[
        bool, typer.Option("--new-key", help="A new signing key; all phones pair again.")
    ] = False,
    files: FilesUrl = "",
    name: Annotated[
        list[str] | None,
        typer.Option("--name", help="What else browsers call this server; may be repeated."),
    ] = None,
    mqtt: Mqtt = "",
    mqtt_credentials: Credentials = None,
    mqtt_authority: Authority = None,
    position_days: PositionDays = 1.0,
    local_webhooks: LocalWebhooks = False,
) -> None:
    """Run the server and its phone page; prints the address and its QR code."""
    from elfslam.serve.network.addresses import checked_names, name_in
    from elfslam.serve.network.running import Listening, run
    from elfslam.serve.settings import ServerSettings

    say("starting; after an installation this takes half a minute")
    check_on(on)
    settings = ServerSettings(
        data.expanduser(),
        database,
        secure_cookie=not http,
        run_jobs=jobs,
        on=on,
        allow_public=allow_public,
        names=checked_names([*(name or ()), *name_in(address)]),
        files_url=files,
        broker=_broker(mqtt, mqtt_credentials, mqtt_authority),
        local_webhooks=local_webhooks,
        limits=_limits(position_days),
    )
    run(settings, Listening(host, port, http, new_token, new_key, address), print_line)


def invite_command(
    name: Annotated[str, typer.Argument(help="Who may upload and read their own walks.")],
    data: DataFolder = DATA_FOLDER,
    database: Database = "",
) -> None:
    """Let somebody else use the server; prints the address that pairs their phone."""
    from elfslam.serve.network.running import code_lines, invite
    from elfslam.serve.settings import ServerSettings

    known, url = invite(ServerSettings(data.expanduser(), database), name)
    for line in [url, *code_lines(url), f"{known} scans this once; it is not shown again."]:
        print_line(line)


def _limits(position_days: float) -> Limits:
    from elfslam.serve.settings import Limits

    if not 0 <= position_days <= MOST_DAYS:
        raise InputError(
            f"--position-days {position_days:g}: wanted 0 to {MOST_DAYS} days, such as 1"
        )
    return Limits(position_days=position_days)


def _broker(url: str, credentials: Path | None, authority: Path | None) -> Broker | None:
    """The broker of the options; None without one. Raises InputError."""
    from elfslam.serve.positions.mqtt import client_of, parse_broker

    if not url:
        if credentials or authority:
            raise InputError(
                "--mqtt-credentials, --mqtt-authority: of which broker? add --mqtt URL"
            )
        return None
    broker = parse_broker(url, credentials, authority)
    client_of(broker)  # what cannot work is said before the server starts
    return broker


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
    from elfslam.serve.buildings.files import index_floor
    from elfslam.serve.buildings.publishing import Spot, floor_of, publish
    from elfslam.serve.buildings.senses import WifiFindParameters
    from elfslam.serve.texts import plain_line

    try:
        name = plain_line(building)
    except ValueError as error:
        raise ParameterError(f"--building {building!r:.60}: {error}") from error
    lies = _place(at)
    spot = Spot(name, floor, lies.latitude_deg, lies.longitude_deg, altitude)
    services = _services(data, database, files)
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

    withdraw(_services(data, database, files), building, floor)
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
    from elfslam.serve.buildings.files import index_floors
    from elfslam.serve.nearest import NearestParameters

    services = _services(data, database, files)
    print_rows(publishing.published_rows(services), title="Published floors", as_json=False)
    if index:
        floors, spots = index_floors(services, NearestParameters())
        say(f"indexed {spots} spots of {floors} floors")
    if sweep:
        say(f"swept {publishing.sweep(services)} files")


def _services(data: Path, database: str, files: str) -> Services:
    from elfslam.serve.services import open_services
    from elfslam.serve.settings import ServerSettings

    return open_services(ServerSettings(data.expanduser(), database, files_url=files))


def _place(text: str) -> Origin:
    try:
        return parse_origin(text)
    except ParameterError as error:
        said = str(error).replace("origin", "at", 1).replace("[,BEARING_DEG]", "")
        raise ParameterError(said, argument="at") from error
