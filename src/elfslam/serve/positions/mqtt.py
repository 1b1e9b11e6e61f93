"""Publishes positions to an MQTT broker; one that is away costs what comes meanwhile alone."""

from __future__ import annotations

import logging
import sys
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

from elfslam.base.errors import InputError
from elfslam.base.extras import installing
from elfslam.base.urls import shown_url

if TYPE_CHECKING:
    from paho.mqtt.client import Client

    from elfslam.serve.positions.values import LivePosition
    from elfslam.serve.services import Services

LOG = logging.getLogger("elfslam.serve")
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
            f"broker {shown_url(url):.80}: wanted mqtt[s]://HOST[:PORT]/PREFIX, the prefix without "
            "+ and #, such as mqtts://broker.example.org/elfslam",
            argument="mqtt",
        )
    if authority is not None and not authority.is_file():
        raise InputError(
            f"{authority}: there is no such file; give a PEM file", argument="mqtt_authority"
        )
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
        raise InputError(
            f"{file}: cannot be read; give a text file", argument="mqtt_credentials"
        ) from error
    if not (user and colon) or "\n" in password:
        raise InputError(f"{file}: wanted one line, USER:PASSWORD", argument="mqtt_credentials")
    return user, password


MOST_WAITING = 1000
"""Positions; the oldest give way."""
CONNECT_S, SEND_S, KEEP_ALIVE_S = 5.0, 5.0, 30
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1, 60
"""Between tries to connect; each is twice as long as the one before."""


class MqttPublisher:
    """Takes positions from any thread and publishes them from its own."""

    def __init__(self, broker: Broker) -> None:
        self._broker = broker
        self._waiting: deque[LivePosition] = deque(maxlen=MOST_WAITING)
        self._wanted, self._stopping = threading.Event(), threading.Event()
        self._is_away = False
        self._client = client_of(broker)
        self._client.on_connect = self._on_connect
        self._client.on_connect_fail = self._on_connect_fail
        self._client.on_disconnect = self._on_disconnect
        self._thread = threading.Thread(target=self._work, name="mqtt", daemon=True)

    @property
    def waiting(self) -> int:
        """How many positions wait."""
        return len(self._waiting)

    @property
    def is_connected(self) -> bool:
        """Whether the broker takes what comes."""
        return self._client.is_connected()

    def start(self) -> None:
        """Connect, now or as soon as that is possible; waits for nobody."""
        broker = self._broker
        self._client.connect_async(broker.host, broker.port, KEEP_ALIVE_S)
        self._client.loop_start()
        self._thread.start()

    def take(self, positions: Sequence[LivePosition]) -> None:
        """Publish these as soon as possible."""
        self._waiting.extend(positions)
        self._wanted.set()

    def stop(self) -> None:
        """End; what waits is dropped."""
        self._stopping.set()
        self._wanted.set()
        self._client.disconnect()
        self._client.loop_stop()
        self._thread.join(SEND_S)

    def _work(self) -> None:
        while not self._stopping.is_set():
            self._wanted.wait()
            self._wanted.clear()
            while self._waiting and not self._stopping.is_set():
                self._publish(self._waiting.popleft())

    def _publish(self, position: LivePosition) -> None:
        """Where nobody is there to take it, a position is dropped: it would come too late."""
        if not self._client.is_connected():
            return
        topic = self._broker.topic(position.map, position.walker)
        try:
            sent = self._client.publish(topic, position.model_dump_json())
            sent.wait_for_publish(SEND_S)  # so no more than this one waits in the client
        except (RuntimeError, ValueError):  # the connection has just ended
            return

    def _on_connect(self, _client: Any, _data: Any, _flags: Any, reason: Any, _more: Any) -> None:
        if reason.is_failure:
            self._say_away(str(reason))
        elif self._is_away:
            self._is_away = False
            LOG.warning("MQTT: %s is back", self._broker.shown)

    def _on_connect_fail(self, _client: Any, _data: Any) -> None:
        self._say_away(str(sys.exc_info()[1] or "no connection"))

    def _on_disconnect(self, *_told: Any) -> None:
        if not self._stopping.is_set():
            self._say_away("the connection has ended")

    def _say_away(self, why: str) -> None:
        """Once, until it is back."""
        if not self._is_away:
            self._is_away = True
            LOG.warning(
                "MQTT: %s is away (%.120s); positions are not published until it is back",
                self._broker.shown,
                why,
            )


def client_of(broker: Broker) -> Client:
    """A client that comes back by itself. Raises InputError where it cannot be made."""
    try:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion
    except ModuleNotFoundError as error:
        raise InputError(f"paho-mqtt is missing; {installing('serve')}", argument="mqtt") from error
    client = Client(CallbackAPIVersion.VERSION2)
    client.connect_timeout = CONNECT_S
    client.reconnect_delay_set(FIRST_PAUSE_S, LONGEST_PAUSE_S)
    if broker.user is not None:
        client.username_pw_set(broker.user, broker.password)
    if broker.is_secure:
        try:
            client.tls_set(None if broker.authority is None else str(broker.authority))
        except OSError as error:
            raise InputError(
                f"{broker.authority}: holds no certificates; give a PEM file",
                argument="mqtt_authority",
            ) from error
    return client


@contextmanager
def publishing(services: Services) -> Iterator[None]:
    """Positions go to the broker that the server was told of, if it was."""
    broker = services.settings.broker
    if broker is None:
        yield
        return
    publisher = MqttPublisher(broker)
    publisher.start()
    try:
        with services.positions.feeding(publisher.take):
            yield
    finally:
        publisher.stop()
