"""MQTT: a real broker gets what comes; one that is away costs nothing but what came meanwhile."""

import json
import logging
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trustme
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from elfslam.base.errors import InputError
from elfslam.cli.server import _broker
from elfslam.serve.positions import mqtt
from elfslam.serve.positions.mqtt import Broker, MqttPublisher, parse_broker
from elfslam.serve.settings import ServerSettings
from studies.benchmarks.served import free_port
from tests.serve.conftest import Somebody
from tests.serve.positions.conftest import Message, OwnBroker, position
from tests.waiting import until

Heard = list[tuple[str, dict[str, Any]]]


@contextmanager
def listening(port: int) -> Iterator[Heard]:
    """What a subscriber to everything hears."""
    heard: Heard = []
    ready: list[bool] = []
    client = Client(CallbackAPIVersion.VERSION2)
    client.on_message = lambda _c, _d, m: heard.append((m.topic, json.loads(m.payload)))
    client.on_connect = lambda c, *_: c.subscribe("#")
    client.on_subscribe = lambda *_: ready.append(True)
    client.connect("127.0.0.1", port)
    client.loop_start()
    until(lambda: ready, "the subscription")
    yield heard
    client.disconnect()
    client.loop_stop()


@contextmanager
def publishing(broker: Broker) -> Iterator[MqttPublisher]:
    publisher = MqttPublisher(broker)
    publisher.start()
    yield publisher
    publisher.stop()


@pytest.mark.real
def test_each_position_is_published_as_json(mosquitto: OwnBroker) -> None:
    mosquitto.start()
    with (
        listening(mosquitto.port) as heard,
        publishing(Broker("127.0.0.1", mosquitto.port, "house/elfslam")) as publisher,
    ):
        until(lambda: publisher.is_connected, "the connection")
        publisher.take([position(x_m=float(k)) for k in range(300)])
        until(lambda: len(heard) == 300, "all positions")
    assert {topic for topic, _ in heard} == {f"house/elfslam/{'a' * 32}/{'b' * 32}"}
    assert [told["x_m"] for _, told in heard] == [float(k) for k in range(300)]
    assert (heard[0][1]["name"], heard[0][1]["latitude_deg"]) == ("Ada", None)


@pytest.mark.real
def test_a_broker_that_comes_back_is_found_again_and_that_is_said_once(
    mosquitto: OwnBroker, caplog: pytest.LogCaptureFixture
) -> None:
    mosquitto.start()
    with (
        caplog.at_level(logging.WARNING),
        publishing(Broker("127.0.0.1", mosquitto.port, "x")) as publisher,
    ):
        until(lambda: publisher.is_connected, "the connection")
        mosquitto.stop()
        until(lambda: not publisher.is_connected, "the end of the connection")
        publisher.take([position(x_m=1.0)])
        until(lambda: publisher.waiting == 0, "what nobody takes is dropped")
        mosquitto.start()
        until(lambda: publisher.is_connected, "the connection again")
        with listening(mosquitto.port) as heard:
            publisher.take([position(x_m=2.0)])
            until(lambda: heard, "a position")
    assert [told["x_m"] for _, told in heard] == [2.0]
    said = [record.message for record in caplog.records if record.message.startswith("MQTT")]
    assert len(said) == 2
    assert "is away" in said[0]
    assert "is back" in said[1]


@pytest.mark.real
def test_without_a_broker_nothing_waits_and_it_is_said_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mqtt, "LONGEST_PAUSE_S", 1)
    tries: list[bool] = []
    with caplog.at_level(logging.WARNING):
        publisher = MqttPublisher(Broker("127.0.0.1", free_port(), "x"))
        said = publisher._client.on_connect_fail
        assert said is not None

        def failed(client: Any, data: Any) -> None:
            tries.append(True)
            said(client, data)

        publisher._client.on_connect_fail = failed
        publisher.start()
        for _ in range(20):
            publisher.take(500 * [position()])
            assert publisher.waiting <= mqtt.MOST_WAITING
        until(lambda: len(tries) >= 2, "a second try")
        until(lambda: publisher.waiting == 0, "an empty queue")
        publisher.stop()
    [line] = [record.message for record in caplog.records]
    assert "is away" in line
    assert "Connection refused" in line


# paho leaves the socket of a handshake that failed to the collector.
@pytest.mark.real
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_over_tls_the_broker_is_verified(
    mosquitto: OwnBroker, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    authority = trustme.CA()
    authority.cert_pem.write_to_path(str(tmp_path / "ca.pem"))
    made = authority.issue_cert("localhost")
    made.private_key_pem.write_to_path(str(tmp_path / "key.pem"))
    made.cert_chain_pems[0].write_to_path(str(tmp_path / "cert.pem"))
    passwords = tmp_path / "passwords"
    passwords.touch(mode=0o600)
    subprocess.run(["mosquitto_passwd", "-b", passwords, "me", "word"], check=True)
    mosquitto.start(
        f"certfile {tmp_path / 'cert.pem'}", f"keyfile {tmp_path / 'key.pem'}",
        f"password_file {passwords}", "allow_anonymous false",
    )  # fmt: skip
    told = Broker(
        "localhost", mosquitto.port, "x", is_secure=True, user="me", password="word",
        authority=tmp_path / "ca.pem",
    )  # fmt: skip
    with publishing(told) as publisher:
        until(lambda: publisher.is_connected, "the connection")
    for wrong, line in (
        (replace(told, authority=None), "CERTIFICATE_VERIFY_FAILED"),
        (replace(told, host="127.0.0.1"), "mismatch"),
        (replace(told, password="other"), "authori"),
    ):
        caplog.clear()
        with caplog.at_level(logging.WARNING), publishing(wrong) as publisher:
            until(lambda: caplog.records, f"the refusal of {wrong}")
            assert not publisher.is_connected
        assert line in caplog.records[0].message
        assert "word" not in caplog.text


class TestTheWholeWay:
    """A server that was told of a broker."""

    @pytest.fixture
    def settings(self, settings: ServerSettings, mosquitto: OwnBroker) -> ServerSettings:
        mosquitto.start()
        return replace(settings, broker=Broker("127.0.0.1", mosquitto.port, "elfslam"))

    def test_what_a_walker_tells_is_published(
        self, owner: Somebody, mosquitto: OwnBroker, map_id: str, message: Message
    ) -> None:
        with listening(mosquitto.port) as heard:

            def told() -> bool:
                owner.post("/api/positions", json=message())
                return bool(heard)

            until(told, "a position", between=lambda: time.sleep(0.3))
        me = owner.id
        assert heard[0][0] == f"elfslam/{map_id}/{me}"
        assert heard[0][1] == {
            **owner.get("/api/positions").json()[-1],
            "time_utc": heard[0][1]["time_utc"],
        }


def test_a_url_comes_apart() -> None:
    assert parse_broker("mqtt://h/elfslam") == Broker("h", 1883, "elfslam")
    assert parse_broker("mqtts://h:99/a/b/") == Broker("h", 99, "a/b", is_secure=True)
    told = parse_broker("mqtts://me:p%40ss@h/x")
    assert (told.port, told.user, told.password) == (8883, "me", "p@ss")
    assert told.topic("m", "w") == "x/m/w"


def test_what_is_shown_holds_no_password() -> None:
    told = parse_broker("mqtt://me:secret@h/x")
    assert "secret" not in f"{told!r} {told.shown}"


def test_credentials_may_lie_in_a_file(tmp_path: Path) -> None:
    file = tmp_path / "credentials"
    file.write_text("me:a:b\n")
    told = parse_broker("mqtt://h/x", file)
    assert (told.user, told.password) == ("me", "a:b")
    for wrong in ("", "me", ":word", "me:a\nyou:b"):
        file.write_text(wrong)
        with pytest.raises(InputError, match="wanted one line, USER:PASSWORD"):
            parse_broker("mqtt://h/x", file)
    with pytest.raises(InputError, match="cannot be read"):
        parse_broker("mqtt://h/x", tmp_path / "missing")


@pytest.mark.parametrize(
    "url",
    ["h/x", "http://h/x", "mqtt:///x", "mqtt://h", "mqtt://h/", "mqtt://h/a+b", "mqtt://h/a/%23",
     "mqtt://h/x?y", "mqtt://h/x#y", "mqtt://h:0/x", "mqtt://h:x/x", "mqtt://[::1/x"],
)  # fmt: skip
def test_what_is_no_broker_is_refused(url: str) -> None:
    with pytest.raises(InputError, match=r"wanted mqtt.s.://HOST"):
        parse_broker(url)


def test_a_refusal_repeats_no_password() -> None:
    with pytest.raises(InputError) as refused:
        parse_broker("mqtt://me:secret@h/a+b")
    assert "secret" not in str(refused.value)


def test_what_cannot_work_is_said_before_the_server_starts(tmp_path: Path) -> None:
    assert _broker("", None, None) is None
    with pytest.raises(InputError, match="add --mqtt URL"):
        _broker("", tmp_path, None)
    with pytest.raises(InputError, match="there is no such file"):
        _broker("mqtts://h/x", None, tmp_path / "missing.pem")
    empty = tmp_path / "empty.pem"
    empty.write_text("none\n")
    with pytest.raises(InputError, match="holds no certificates"):
        _broker("mqtts://h/x", None, empty)
    assert _broker("mqtt://h/x", None, None) == Broker("h", 1883, "x")
