"""The verbs of the server on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest
from starlette.testclient import TestClient
from typer.testing import CliRunner

from elfslam.base.errors import InputError, StoreError
from elfslam.cli.app import app as command
from elfslam.serve.app import create_app
from elfslam.serve.network import running
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings

RUNNER = CliRunner()


def test_an_invitation_opens_the_door(tmp_path: Path) -> None:
    said = RUNNER.invoke(command, ["invite", "Zoë", "--data", str(tmp_path / "data")])
    assert said.exit_code == 0
    token = said.stdout.splitlines()[0].partition("#token=")[2].partition("&key=")[0]
    app = create_app(open_services(ServerSettings(tmp_path / "data")))
    client = TestClient(app, client=("127.0.0.1", 1), base_url="http://127.0.0.1")
    told = client.get("/api/me", headers={"Authorization": f"Bearer {token}"}).json()
    assert (told["name"], told["is_owner"]) == ("Zoë", False)
    app.state.services.engine.dispose()


def test_serving_beyond_the_network_wants_a_word(tmp_path: Path) -> None:
    said = RUNNER.invoke(command, ["serve", "--data", str(tmp_path), "--host", "0.0.0.0"])
    assert isinstance(said.exception, InputError)
    assert "--allow-public" in str(said.exception)


def test_a_name_that_is_none_is_refused(tmp_path: Path) -> None:
    words = ["serve", "--data", str(tmp_path / "data"), "--name", "https://floors.example.org"]
    said = RUNNER.invoke(command, words)
    assert isinstance(said.exception, InputError)
    assert "wanted such as floors.example.org" in str(said.exception)
    assert not (tmp_path / "data").exists()


def test_workers_that_are_nobody_are_refused_before_anything_is_made(tmp_path: Path) -> None:
    said = RUNNER.invoke(command, ["serve", "--data", str(tmp_path / "data"), "--on", "two"])
    assert isinstance(said.exception, InputError)
    assert "wanted a number of processes, ray or ray://" in str(said.exception)
    assert not (tmp_path / "data").exists()


def test_what_is_said_of_positions_reaches_the_server(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[ServerSettings] = []
    monkeypatch.setattr(running, "run", lambda settings, *_: told.append(settings))
    words = ["--mqtt", "mqtt://broker/floors", "--position-days", "0.5", "--local-webhooks"]
    for more in ([], words):
        said = RUNNER.invoke(command, ["serve", "--data", str(tmp_path / "data"), *more])
        assert said.exit_code == 0
    usual, asked = told
    assert (usual.broker, usual.limits.position_days, usual.local_webhooks) == (None, 1.0, False)
    assert (asked.broker and asked.broker.prefix, asked.limits.position_days) == ("floors", 0.5)
    assert asked.local_webhooks


@pytest.mark.parametrize("days", ["-1", "nan", "inf", "4000"])
def test_a_time_that_is_none_is_refused(tmp_path: Path, days: str) -> None:
    words = ["serve", "--data", str(tmp_path / "data"), "--position-days", days]
    said = RUNNER.invoke(command, words)
    assert isinstance(said.exception, InputError)
    assert "wanted 0 to 3650 days" in str(said.exception)
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("words", [["serve"], ["invite", "Zoë"]])
def test_a_data_folder_that_is_none(tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "text").write_text("mine")
    for folder in ("text", "text/below"):
        said = RUNNER.invoke(command, [*words, "--data", str(tmp_path / folder)])
        assert isinstance(said.exception, StoreError)
        assert "give a folder that you may write to" in str(said.exception)
    assert (tmp_path / "text").read_text() == "mine"


def test_a_database_that_is_none_is_said(tmp_path: Path) -> None:
    said = RUNNER.invoke(command, ["serve", "--data", str(tmp_path), "--database", "nonsense"])
    assert isinstance(said.exception, InputError)
    assert "wanted such as postgresql" in str(said.exception)
