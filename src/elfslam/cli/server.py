"""Verbs of the server: serve, and invite somebody."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from elfslam.app.console import print_line
from elfslam.app.workers.choosing import check_on
from elfslam.base.errors import InputError
from elfslam.cli.options import On

if TYPE_CHECKING:
    from elfslam.serve.positions.mqtt import Broker
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
    """The limits of the options. Raises InputError."""
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
