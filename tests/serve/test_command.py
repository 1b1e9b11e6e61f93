"""The verbs of the server on the command line."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from elfslam.base.errors import InputError, StoreError
from elfslam.cli.app import app as command
from elfslam.serve.app import create_app
from elfslam.serve.network import running
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from tests.serve.conftest import asking

RUNNER = CliRunner()


def test_an_invitation_opens_the_door(tmp_path: Path) -> None:
    said = RUNNER.invoke(command, ["invite", "Zoë", "--data", str(tmp_path / "data")])
    assert said.exit_code == 0
    token = said.stdout.splitlines()[0].partition("#token=")[2].partition("&key=")[0]
    app = create_app(open_services(ServerSettings(tmp_path / "data")))
    told = asking(app, headers={"Authorization": f"Bearer {token}"}).get("/api/me").json()
    assert (told["name"], told["is_owner"]) == ("Zoë", False)
    app.state.services.engine.dispose()


@pytest.mark.parametrize(
    ("option", "given", "words"),
    [
        ("--host", "0.0.0.0", "--allow-public"),
        ("--name", "https://floors.example.org", "wanted such as floors.example.org"),
        ("--on", "two", "wanted a number of processes, ray or ray://"),
        *(
            ("--position-days", days, "wanted 0 to 3650 days")
            for days in ("-1", "nan", "inf", "4000")
        ),
    ],
)
def test_an_option_that_makes_no_sense_is_refused_before_anything_is_made(
    tmp_path: Path, option: str, given: str, words: str
) -> None:
    said = RUNNER.invoke(command, ["serve", "--data", str(tmp_path / "data"), option, given])
    assert isinstance(said.exception, InputError)
    assert words in str(said.exception)
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
