"""What every request passes: whence it comes, how often, and what headers the answer has."""

import asyncio
import socket
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from fastapi import FastAPI
from starlette.datastructures import Headers
from starlette.testclient import TestClient
from starlette.types import Message

from elfslam.serve.app import create_app
from elfslam.serve.people.access import new_token
from elfslam.serve.people.guards import ONLY_HTTPS, Body, same_origin
from elfslam.serve.people.users import set_owner_token
from elfslam.serve.problems import Problem
from elfslam.serve.services import MOST_BUCKETS, Rates, open_services
from elfslam.serve.settings import Limits, ServerSettings
from tests.serve.conftest import asking

OWN_NAME = socket.gethostname().partition(".")[0]


@pytest.fixture
def app_of_a_name(settings: ServerSettings) -> Iterator[FastAPI]:
    """An app that was told its public name."""
    app = create_app(open_services(replace(settings, names=("floors.example.org",))))
    yield app
    app.state.services.engine.dispose()


def test_strangers_are_refused(app: FastAPI, settings: ServerSettings, tmp_path: Path) -> None:
    stranger = asking(app, "8.8.8.8")
    answer = stranger.get("/api/version")
    assert answer.status_code == 403
    assert "own network" in answer.json()["detail"]
    open_app = create_app(
        open_services(replace(settings, data_folder=tmp_path / "open", allow_public=True))
    )
    assert asking(open_app, "8.8.8.8").get("/api/version").is_success


OURS = [
    {},
    {"origin": "https://10.0.0.1:8443", "host": "10.0.0.1:8443"},
    {"origin": "https://Floors.Example.org", "host": "floors.example.org"},
]
OF_OTHERS = [
    *({"origin": each, "host": "10.0.0.1:8443"} for each in ("http://10.0.0.1:8443", "null")),
    *(
        {"origin": f"https://{each}", "host": "10.0.0.1:8443"}
        for each in ("10.0.0.1:8444", "evil.a")
    ),
    *({"origin": each, "host": ""} for each in ("", "https://")),
    {"origin": "https://[::1", "host": "x"},
    *({"sec-fetch-site": each} for each in ("cross-site", "same-site")),
]


def test_whose_page_it_was() -> None:
    assert all(same_origin(Headers(each), "https") for each in OURS)
    assert not any(same_origin(Headers(each), "https") for each in OF_OTHERS)


def test_other_sites_cannot_act(owner: TestClient) -> None:
    foreign = {"Origin": "https://evil.example"}
    made = owner.post("/api/recordings", json={"name": "walk"}, headers=foreign)
    assert made.status_code == 403
    assert owner.get("/api/recordings", headers=foreign).json() == []


def test_a_page_without_tls_cannot_act_on_one_with(owner: TestClient) -> None:
    owner.base_url = "https://127.0.0.1"  # type: ignore[assignment]
    for scheme, status in (("http", 403), ("https", 201)):
        origin = {"Origin": f"{scheme}://127.0.0.1"}
        made = owner.post("/api/recordings", json={"name": "walk"}, headers=origin)
        assert made.status_code == status


OUR_HOSTS = (
    f"127.0.0.1:8443 203.0.113.9 [2001:db8::1]:8443 localhost:1 LOCALHOST {OWN_NAME}.local:8443"
)
OUR_HOSTS += " floors.example.org Floors.Example.org:443"
OTHER_HOSTS = (
    "evil.example evil.floors.example.org 127.0.0.1.evil.example [127.0.0.1 [evil.example]"
)


def test_by_which_names_it_may_be_called(app_of_a_name: FastAPI) -> None:
    client = asking(app_of_a_name)
    for host in OUR_HOSTS.split():
        assert client.get("/api/version", headers={"Host": host}).status_code == 200, host
    for host in ("", "localhost.evil.example:8443", *OTHER_HOSTS.split()):
        answer = client.get("/api/version", headers={"Host": host})
        assert answer.status_code == 421, host
        assert answer.headers["content-type"] == "application/problem+json"
        assert "--name" in answer.json()["detail"]


def test_only_names_that_were_given_are_kept_to_https(app_of_a_name: FastAPI) -> None:
    given, own = "floors.example.org", ("localhost", f"{OWN_NAME}.local", "127.0.0.1")
    for url in (f"https://{given}", f"http://{given}", *(f"https://{each}" for each in own)):
        client = asking(app_of_a_name, base_url=url)
        told = client.get("/api/version").headers.get("strict-transport-security")
        assert told == (ONLY_HTTPS if url == f"https://{given}" else None)


def test_every_answer_is_guarded(anyone: TestClient) -> None:
    for path in ("/", "/api/version", "/api/nowhere", "/nowhere.js"):
        headers = anyone.get(path).headers
        assert "default-src 'self'" in headers["content-security-policy"]
        assert "unsafe-inline" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "microphone=(self)" in headers["permissions-policy"]
        assert "geolocation=(self)" in headers["permissions-policy"]


def test_what_is_not_there_is_a_problem(anyone: TestClient) -> None:
    there_is_none = [anyone.get("/api/nowhere"), anyone.get("/nowhere.js")]
    answers = [*there_is_none, anyone.put("/api/version")]
    assert [answer.status_code for answer in answers] == [404, 404, 405]
    for answer in answers:
        assert answer.headers["content-type"] == "application/problem+json"


def test_pages_do_not_lead_out(anyone: TestClient) -> None:
    for path in ("/../settings.py", "/%2e%2e/settings.py", "/..%2fsettings.py"):
        assert anyone.get(path).status_code == 404, path


def limited(settings: ServerSettings, **limits: float) -> TestClient:
    given = Limits(**limits)  # type: ignore[arg-type]
    return asking(create_app(open_services(replace(settings, limits=given))))


def test_haste_is_refused_by_address(settings: ServerSettings) -> None:
    client = limited(settings, address_requests_per_s=0.01, burst_s=300.0)
    answers = [client.get("/api/version") for _ in range(4)]
    assert [answer.status_code for answer in answers] == [200, 200, 200, 429]
    assert 0 < int(answers[-1].headers["retry-after"]) <= 100


def test_haste_is_refused_by_token(settings: ServerSettings) -> None:
    client, token = limited(settings, token_requests_per_s=0.01, burst_s=200.0), new_token()
    set_owner_token(client.app.state.services, token)  # type: ignore[attr-defined]
    mine = {"Authorization": f"Bearer {token}"}
    codes = [client.get("/api/me", headers=mine).status_code for _ in range(3)]
    assert codes == [200, 200, 429]
    assert client.get("/api/version").status_code == 200


def test_a_bucket_fills_as_time_goes_by() -> None:
    now_s = [0.0]
    rates = Rates(2.0, 1.5, lambda: now_s[0])
    assert [rates.take("a") for _ in range(4)] == [0, 0, 0, 0.5]
    assert rates.take("b") == 0
    now_s[0] = 0.5
    assert rates.take("a") == 0
    assert rates.take("a") > 0


def test_buckets_are_bounded() -> None:
    now_s = [0.0]
    rates = Rates(1.0, 1.0, lambda: now_s[0])
    for k in range(MOST_BUCKETS + 10):
        rates.take(str(k))
    assert len(rates._buckets) <= MOST_BUCKETS


def test_wrong_tokens(anyone: TestClient) -> None:
    for token in ("x", "", "é", "a" * 5000, "' OR 1=1 --"):
        header = {"Authorization": f"Bearer {token}".encode()}
        assert anyone.get("/api/me", headers=header).status_code == 401  # type: ignore[arg-type]
    assert anyone.get("/api/me", headers={"Authorization": "Basic eDp5"}).status_code == 401


SILENCE_S, PACE = 0.2, 1000.0
GONE = {"type": "http.disconnect"}


def piece(size: int, *, more: bool = True) -> Message:
    return {"type": "http.request", "body": bytes(size), "more_body": more}


def sending(pieces: Iterator[Message], pause_s: float) -> Callable[[], Awaitable[Message]]:
    """A client that pauses before every piece, and says nothing after the last."""

    async def receive() -> Message:
        await asyncio.sleep(pause_s)
        for each in pieces:
            return each
        await asyncio.Event().wait()
        raise AssertionError

    return receive


async def came(pieces: list[Message], pause_s: float, most_bytes: int = 10_000) -> int:
    """How many messages are received until the body or the connection ends. Raises Problem."""
    body = Body(sending(iter(pieces), pause_s), most_bytes, SILENCE_S, PACE)
    count = 1
    while (await body.receive()).get("more_body", False):
        count += 1
    return count


async def refusal(pieces: list[Message], pause_s: float, most_bytes: int = 10_000) -> Problem:
    with pytest.raises(Problem) as refused:
        await came(pieces, pause_s, most_bytes)
    return refused.value


@pytest.mark.anyio
async def test_silence_is_refused() -> None:
    told = await refusal([piece(5000)], 0)
    assert told.status_code == 408
    assert told.headers == {"Connection": "close"}
    assert "go on from the offset" in told.detail


@pytest.mark.anyio
async def test_dripping_is_refused_though_no_pause_is_long() -> None:
    pieces = [*[piece(1)] * 20, piece(0, more=False)]
    assert (await refusal(pieces, SILENCE_S / 8)).status_code == 408


@pytest.mark.anyio
async def test_what_keeps_the_pace_may_take_long() -> None:
    """Twice as fast as it must be, for twice as long as silence may last."""
    pause_s = SILENCE_S / 10
    pieces = [piece(round(2 * PACE * pause_s))] * 20
    assert await came([*pieces, piece(0, more=False)], pause_s) == 21


@pytest.mark.anyio
async def test_the_end_of_a_connection_is_waited_for() -> None:
    pieces = iter([piece(1, more=False), GONE])
    body = Body(sending(pieces, 0.75 * SILENCE_S), 10, SILENCE_S, PACE)

    assert await body.receive() == piece(1, more=False)
    assert await asyncio.wait_for(body.receive(), 30) == GONE


@pytest.mark.anyio
async def test_too_much_is_refused_as_it_comes() -> None:
    assert (await refusal([piece(60), piece(41)], 0, most_bytes=100)).status_code == 413
    assert await came([piece(60), piece(40, more=False)], 0, most_bytes=100) == 2
