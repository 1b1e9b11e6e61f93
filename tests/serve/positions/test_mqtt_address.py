"""The URL of a broker, and where its credentials come from."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from elfslam.cli.server import _broker
from elfslam.serve.positions.mqtt_address import Broker, parse_broker


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
    with pytest.raises(InputError, match="wanted mqtt://HOST"):
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
