"""What the owner of a map sets, and the webhooks that they register."""

from __future__ import annotations

from dataclasses import replace

import pytest
from starlette.testclient import TestClient

from elfslam.serve.positions import targets
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings

pytestmark = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)
URL = "https://hooks.example.org/positions?key=1"


@pytest.fixture(autouse=True)
def found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Names lead to addresses that are planted here."""
    known = {"hooks.example.org": ["93.184.216.34"], "inside.example.org": ["10.0.0.7"]}
    known["127.0.0.1"] = ["127.0.0.1"]

    def resolve(host: str, port: int) -> list[str]:
        if host not in known:
            raise OSError(8, "Name or service not known")
        return known[host]

    monkeypatch.setattr(targets, "resolved", resolve)


def hooks_of(map_id: str) -> str:
    return f"/api/maps/{map_id}/webhooks"


def test_a_webhook_is_told_its_secret_once(owner: TestClient, map_id: str) -> None:
    made = owner.post(hooks_of(map_id), json={"url": URL})
    assert made.status_code == 201
    assert len(made.json()["secret"]) >= 32
    given = owner.post(hooks_of(map_id), json={"url": URL, "secret": "s" * 16}).json()
    assert given["secret"] == "s" * 16
    told = owner.get(hooks_of(map_id)).json()
    assert {each["id"] for each in told} == {made.json()["id"], given["id"]}
    assert {each["url"] for each in told} == {URL}
    assert [(each["delivered"], each["dropped"], each["last_error"]) for each in told] == 2 * [
        (0, 0, None)
    ]
    assert not any("secret" in each for each in told)


def test_a_webhook_is_deleted_by_its_map_alone(owner: TestClient, map_id: str) -> None:
    made = owner.post(hooks_of(map_id), json={"url": URL}).json()
    assert owner.delete(f"{hooks_of('0' * 32)}/{made['id']}").status_code == 404
    assert owner.delete(f"{hooks_of(map_id)}/{'0' * 32}").status_code == 404
    assert owner.delete(f"{hooks_of(map_id)}/{made['id']}").status_code == 204
    assert owner.get(hooks_of(map_id)).json() == []


def test_webhooks_are_few(owner: TestClient, services: Services, map_id: str) -> None:
    most = services.settings.limits.webhooks
    answers = [owner.post(hooks_of(map_id), json={"url": URL}).status_code for _ in range(most + 1)]
    assert answers == most * [201] + [409]


@pytest.mark.parametrize(
    ("url", "line"),
    [
        ("ftp://hooks.example.org/", "wanted http"),
        ("https://me:word@hooks.example.org/", "without a user"),
        ("https://127.0.0.1/", "not public"),
        ("http://inside.example.org/", "leads to 10.0.0.7"),
        ("http://nobody.example.org/", "is not found"),
    ],
)
def test_where_a_webhook_may_not_lead_is_said(
    owner: TestClient, map_id: str, url: str, line: str
) -> None:
    refused = owner.post(hooks_of(map_id), json={"url": url})
    assert refused.status_code == 422
    assert line in refused.json()["detail"]
    assert owner.get(hooks_of(map_id)).json() == []


def test_a_short_secret_is_refused(owner: TestClient, map_id: str) -> None:
    assert owner.post(hooks_of(map_id), json={"url": URL, "secret": "short"}).status_code == 422


class TestLocalWebhooks:
    """The server was started with --local-webhooks."""

    @pytest.fixture
    def settings(self, settings: ServerSettings) -> ServerSettings:
        return replace(settings, local_webhooks=True)

    def test_they_may_lead_inside(self, owner: TestClient, map_id: str) -> None:
        answer = owner.post(hooks_of(map_id), json={"url": "http://inside.example.org/"})
        assert answer.status_code == 201
