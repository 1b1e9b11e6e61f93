"""The MQTT broker that positions are published to, from a URL."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urlsplit

from elfslam.base.errors import InputError
from elfslam.base.urls import shown_url

PORTS = {"mqtt": 1883, "mqtts": 8883}
FORBIDDEN = "+#\0"
"""In topics: wildcards, and what no broker takes."""


@dataclass(frozen=True)
class Broker:
    """Where and how to publish. `authority`: whom to trust over TLS; by default the system's."""

    host: str
    port: int
    prefix: str
    is_secure: bool = False
    user: str | None = None
    password: str | None = field(default=None, repr=False)
    authority: Path | None = None

    @property
    def shown(self) -> str:
        """The address without anything secret."""
        return f"mqtt{'s' if self.is_secure else ''}://{self.host}:{self.port}/{self.prefix}"

    def topic(self, map_id: str, walker: str) -> str:
        """Where the positions of a walker in a map are published."""
        return f"{self.prefix}/{map_id}/{walker}"


def parse_broker(
    url: str, credentials: Path | None = None, authority: Path | None = None
) -> Broker:
    """The broker of mqtt[s]://[USER:PASSWORD@]HOST[:PORT]/PREFIX. Raises InputError.

    `credentials` is a file of one line, USER:PASSWORD.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port
    except ValueError:
        parts, host, port = urlsplit(""), "", None
    prefix = unquote(parts.path).strip("/")
    good = parts.scheme in PORTS and host and prefix and not set(prefix) & set(FORBIDDEN)
    if not good or parts.query or parts.fragment or port == 0:
        raise InputError(
            f"--mqtt: got {shown_url(url):.80}; wanted mqtt://HOST[:PORT]/PREFIX or mqtts://, "
            "the prefix without + and #, such as mqtts://broker.example.org/elfslam"
        )
    if authority is not None and not authority.is_file():
        raise InputError(f"--mqtt-authority {authority}: there is no such file; give a PEM file")
    user, password = _credentials(parts.username, parts.password, credentials)
    is_secure = parts.scheme == "mqtts"
    return Broker(host, port or PORTS[parts.scheme], prefix, is_secure, user, password, authority)


def _credentials(
    user: str | None, password: str | None, file: Path | None
) -> tuple[str | None, str | None]:
    if file is None:
        told = None if password is None else unquote(password)
        return (None if user is None else unquote(user)), told
    try:
        user, colon, password = file.read_text(encoding="utf-8").rstrip("\r\n").partition(":")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"--mqtt-credentials {file}: cannot be read; give a text file") from error
    if not (user and colon) or "\n" in password:
        raise InputError(f"--mqtt-credentials {file}: wanted one line, USER:PASSWORD")
    return user, password
