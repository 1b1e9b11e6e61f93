"""Webhooks: batches, tries, rests and what is dropped; and the whole way to a receiver."""

import asyncio
import contextlib
import json
import re
import ssl
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
import trustme

from elfslam.base.errors import InputError
from elfslam.serve.positions.values import LivePosition
from elfslam.serve.positions.webhooks import (
    MOST_AT_ONCE,
    MOST_WAITING,
    PAUSES_S,
    SIGNATURE,
    TIMESTAMP,
    DeliveryError,
    Hook,
    Outboxes,
    Target,
    WebhookDispatcher,
    address_of,
    digest,
    is_public,
    post,
    signed_headers,
    target_of,
)
from elfslam.serve.settings import ServerSettings
from studies.benchmarks.served import free_port
from tests.serve.conftest import Somebody
from tests.serve.positions.conftest import Message, Receiver, position, serving
from tests.waiting import until

MAP, SECRET = "a" * 32, "s" * 16
AWAY = DeliveryError("answered 503")


@dataclass
class World:
    """A postman, what they brought, and how they were received."""

    answers: list[Exception | None] = field(default_factory=list)
    hooks: list[Hook] = field(default_factory=lambda: [Hook("h", MAP, "https://h/p", SECRET)])
    got: list[tuple[Target, str, dict[str, Any], dict[str, str]]] = field(default_factory=list)
    pauses_s: list[float] = field(default_factory=list)
    now_s: float = 0.0
    outboxes: Outboxes = field(default_factory=Outboxes)
    address: str | Exception = "93.184.216.34"

    def postman(self) -> WebhookDispatcher:
        async def send(
            target: Target, address: str, body: bytes, headers: Mapping[str, str]
        ) -> None:
            assert headers[SIGNATURE] == f"sha256={digest(SECRET, int(headers[TIMESTAMP]), body)}"
            self.got.append((target, address, json.loads(body), dict(headers)))
            answer = self.answers.pop(0) if self.answers else None
            if answer is not None:
                raise answer

        async def pause(pause_s: float) -> None:
            self.pauses_s.append(pause_s)

        def find_address(_target: Target) -> str:
            if isinstance(self.address, Exception):
                raise self.address
            return self.address

        return WebhookDispatcher(
            self.outboxes,
            lambda maps: [hook for hook in self.hooks if hook.map_id in maps],
            find_address,
            send,
            pause,
            lambda: self.now_s,
        )

    async def round(self, postman: WebhookDispatcher) -> None:
        await postman.dispatch()
        await postman.finish()


def run_rounds(world: World, *batches: list[LivePosition], at_s: Sequence[float] = ()) -> list[int]:
    """A round after each batch, a minute apart unless times are told; how much has come by then."""

    async def rounds() -> list[int]:
        postman, seen = world.postman(), []
        for k, batch in enumerate(batches):
            world.now_s = at_s[k] if at_s else 60.0 * k
            world.outboxes.put(batch)
            await world.round(postman)
            seen.append(len(world.got))
        return seen

    return asyncio.run(rounds())


def test_positions_of_a_map_go_to_its_webhook_in_one_batch() -> None:
    world = World()
    run_rounds(world, [position(x_m=1.0), position(x_m=2.0), position(map="f" * 32)])
    [(target, address, body, _)] = world.got
    assert (target.url, address) == ("https://h/p", "93.184.216.34")
    assert body["map"] == MAP
    assert [each["x_m"] for each in body["positions"]] == [1.0, 2.0]
    told = world.outboxes.deliveries_of("h")
    assert (told.delivered, told.dropped, told.last_error) == (2, 0, None)
    assert told.last_delivered_utc is not None


def test_it_is_tried_three_times_and_then_dropped_and_said() -> None:
    world = World(answers=[AWAY, AWAY, AWAY])
    run_rounds(world, [position()], [position(x_m=5.0)])
    assert len(world.got) == 4
    assert world.pauses_s == list(PAUSES_S)
    told = world.outboxes.deliveries_of("h")
    assert (told.delivered, told.dropped) == (1, 1)
    assert told.last_error is None, "the last delivery went well"


def test_the_last_error_is_told_until_it_goes_well() -> None:
    world = World(answers=3 * [AWAY])
    run_rounds(world, [position()])
    told = world.outboxes.deliveries_of("h")
    assert (told.last_error, told.delivered) == ("answered 503", 0)
    assert told.last_error_utc is not None
    world.outboxes.forget("h")
    assert world.outboxes.deliveries_of("h").last_error is None


def test_what_is_refused_for_good_is_not_tried_again() -> None:
    world = World(answers=[DeliveryError("answered 410", is_final=True)])
    run_rounds(world, [position()])
    assert len(world.got) == 1
    assert world.outboxes.deliveries_of("h").dropped == 1


def test_a_name_that_has_moved_inside_is_not_asked() -> None:
    world = World(address=InputError("webhook h: leads to 10.0.0.7, which is not public"))
    run_rounds(world, [position()])
    assert world.got == []
    assert "10.0.0.7" in str(world.outboxes.deliveries_of("h").last_error)


def test_after_a_failure_it_rests_ever_longer() -> None:
    world = World(answers=9 * [DeliveryError("answered 500", is_final=True)])
    at_s = (0.0, 1.9, 2.0, 5.9, 6.0)
    assert run_rounds(world, *(5 * [[position()]]), at_s=at_s) == [1, 1, 2, 2, 3]


def test_a_queue_is_bounded_and_batches_too() -> None:
    world = World()
    run_rounds(world, [position(x_m=float(k)) for k in range(MOST_WAITING + 7)], [], [])
    sizes = [len(body["positions"]) for _, _, body, _ in world.got]
    assert sizes == 3 * [MOST_AT_ONCE]
    assert world.got[0][2]["positions"][0]["x_m"] == 7.0


def test_what_came_while_it_rested_is_counted_as_dropped() -> None:
    world = World(answers=[DeliveryError("answered 500", is_final=True)])
    run_rounds(world, *(n * [position()] for n in (1, MOST_WAITING, 3)), at_s=(0.0, 0.0, 0.0))
    assert world.outboxes.deliveries_of("h").dropped == 1 + 3


@pytest.mark.anyio
async def test_what_a_walker_deletes_while_it_waits_is_not_passed_on() -> None:
    world = World(answers=[DeliveryError("answered 500", is_final=True)])
    postman = world.postman()
    mine, theirs = position(), position(walker="d" * 32, x_m=9.0)
    for waiting in ([mine], [mine, theirs]):
        world.outboxes.put(waiting)
        await world.round(postman)
    world.outboxes.forget_walker(mine.walker, mine.time_utc)
    later = position(x_m=7.0, time_utc=mine.time_utc + timedelta(seconds=1))
    world.outboxes.put([later])
    world.now_s = 60.0
    await world.round(postman)
    assert [each["x_m"] for each in world.got[-1][2]["positions"]] == [9.0, 7.0]
    assert world.outboxes.deliveries_of("h").delivered == 2


def test_where_nothing_is_left_nothing_is_posted() -> None:
    world = World()
    world.outboxes.forget_walker("b" * 32, position().time_utc)
    run_rounds(world, [position(time_utc=position().time_utc - timedelta(seconds=9))])
    assert world.got == []


@pytest.mark.anyio
async def test_a_slow_webhook_keeps_no_other_waiting() -> None:
    stuck, arrived = asyncio.Event(), list[str]()

    async def send(target: Target, *_: object) -> None:
        if target.host == "slow":
            await stuck.wait()
        arrived.append(target.host)

    hooks = [Hook("s", MAP, "http://slow/", SECRET), Hook("q", MAP, "http://quick/", SECRET)]
    outboxes = Outboxes()
    postman = WebhookDispatcher(outboxes, lambda _: hooks, lambda _: "93.184.216.34", send)
    for k in range(2):
        outboxes.put([position()])
        while len(arrived) <= k:
            await postman.dispatch()
            await asyncio.sleep(0.001)
    assert arrived == ["quick", "quick"]
    stuck.set()
    await postman.finish()


@pytest.mark.anyio
async def test_a_deleted_webhook_gets_nothing_more() -> None:
    world = World(answers=[DeliveryError("answered 500", is_final=True)])
    postman = world.postman()
    for hooks, now_s in ((world.hooks, 0.0), (world.hooks, 0.0), ([], 0.0), ([], 1000.0)):
        world.hooks, world.now_s = hooks, now_s
        world.outboxes.put([position()])
        await world.round(postman)
    assert len(world.got) == 1


@pytest.mark.real
class TestTheWholeWay:
    """A server that may post to this machine, and a receiver there."""

    @pytest.fixture
    def settings(self, settings: ServerSettings) -> ServerSettings:
        return replace(settings, local_webhooks=True)

    def test_positions_arrive_signed(
        self, owner: Somebody, map_id: str, receiver: Receiver, message: Message
    ) -> None:
        hooks = f"/api/maps/{map_id}/webhooks"
        made = owner.post(hooks, json={"url": receiver.url}).json()
        receiver.statuses.append(500)
        for k in range(3):
            owner.post("/api/positions", json=message(x_m=float(k)))
        until(lambda: len(receiver.positions) >= 3 and len(receiver.got) >= 2, "the positions")
        _, headers, body = receiver.got[-1]
        wanted = digest(made["secret"], int(headers[TIMESTAMP]), body)
        assert headers[SIGNATURE] == f"sha256={wanted}"
        until(lambda: owner.get(hooks).json()[0]["delivered"] == 3, "the count")
        assert owner.get(hooks).json()[0]["last_error"] is None

    def test_a_receiver_that_is_away_is_said(
        self, owner: Somebody, map_id: str, receiver: Receiver, message: Message
    ) -> None:
        hooks = f"/api/maps/{map_id}/webhooks"
        receiver.statuses.append(410)
        owner.post(hooks, json={"url": receiver.url})
        owner.post("/api/positions", json=message())
        until(lambda: owner.get(hooks).json()[0]["last_error"] == "answered 410", "the error")
        assert owner.get(hooks).json()[0]["dropped"] == 1


PUBLIC = ["93.184.216.34", "2606:2800:220:1:248:1893:25c8:1946", "::ffff:93.184.216.34"]
HIDDEN = [
    "127.0.0.1", "127.1.2.3", "0.0.0.0", "10.0.0.1", "172.16.0.1", "192.168.1.1", "169.254.169.254",
    "100.64.0.1", "224.0.0.1", "240.0.0.1", "255.255.255.255", "::1", "::", "fe80::1", "fc00::1",
    "ff02::1", "::ffff:127.0.0.1", "::ffff:10.0.0.1", "64:ff9b::7f00:1", "64:ff9b::a00:1",
    "2002:7f00:1::", "2002:a00:1::", "fe80::1%eth0", "no address",
]  # fmt: skip


def test_the_internet_is_public_and_no_network_of_ones_own() -> None:
    assert [address for address in PUBLIC if not is_public(address)] == []
    assert [address for address in HIDDEN if is_public(address)] == []


def test_a_url_comes_apart() -> None:
    target = target_of("https://hooks.example.org:8443/a/b?c=d")
    assert (target.is_secure, target.host, target.port) == (True, "hooks.example.org", 8443)
    assert (target.path, target.authority) == ("/a/b?c=d", "hooks.example.org:8443")
    assert target_of("http://[2606:2800::1]").authority == "[2606:2800::1]"
    assert (target_of("http://h").port, target_of("http://h").path) == (80, "/")


NO_URLS = (
    "hooks.example.org //hooks.example.org/ file:///etc/passwd gopher://h/ http:// http://user@h/"
)
NO_URLS += " http://user:word@h/ http://h/#part http://h:0/ http://h:99999/ http://[::1 http://hö/"
NO_URLS += " http://[fe80::1%25eth0]/"


@pytest.mark.parametrize("url", ["", "http://h/a b", "http://h/\r\nX: y", *NO_URLS.split()])
def test_what_is_no_plain_url_is_refused(url: str) -> None:
    with pytest.raises(InputError, match="wanted http"):
        target_of(url)


def test_one_hidden_address_among_public_ones_is_refused() -> None:
    target = target_of("http://h/")
    mixed = ["93.184.216.34", "127.0.0.1"]
    with pytest.raises(InputError, match=r"leads to 127\.0\.0\.1"):
        address_of(target, allow_local=False, resolve=lambda *_: mixed)
    assert address_of(target, allow_local=True, resolve=lambda *_: mixed) == mixed[0]
    assert address_of(target, allow_local=False, resolve=lambda *_: mixed[:1]) == mixed[0]


def test_numbers_are_addresses_whatever_their_form() -> None:
    for host in ("2130706433", "0x7f000001", "0177.0.0.1", "127.1", "localhost"):
        with pytest.raises(InputError):
            address_of(target_of(f"http://{host}/"), allow_local=False)


def test_a_name_that_leads_nowhere_is_said() -> None:
    def nothing(_host: str, _port: int) -> list[str]:
        raise OSError(8, "Name or service not known")

    with pytest.raises(InputError, match=r"is not found \(Name or service not known\)"):
        address_of(target_of("http://h/"), allow_local=True, resolve=nothing)
    with pytest.raises(InputError, match="leads to nowhere"):
        address_of(target_of("http://h/"), allow_local=True, resolve=lambda *_: [])


def test_it_is_what_openssl_computes() -> None:
    # printf '1700000000.{"a":1}' | openssl dgst -sha256 -hmac key
    wanted = "a438e398bfafc57e4396bb7fc2304422f0f768e965d073ca313cb52e22e6ad03"
    headers = signed_headers("key", 1_700_000_000, b'{"a":1}')
    assert headers == {TIMESTAMP: "1700000000", SIGNATURE: f"sha256={wanted}"}


def test_time_body_and_secret_all_count() -> None:
    found = {
        digest(secret, time_s, body)
        for secret in ("one", "two")
        for time_s in (1, 11)
        for body in (b"", b"1.", b".1")
    }
    assert len(found) == 12


ROOT = Path(__file__).resolve().parents[3]


def send(target: Target, body: bytes = b"{}", **more: Any) -> None:
    asyncio.run(post(target, "127.0.0.1", body, {"X-Told": "yes"}, **more))


def elsewhere(receiver: Receiver) -> Target:
    """A name that no name server knows, at the receiver's port."""
    return target_of(receiver.url.replace("127.0.0.1", "hooks.invalid"))


def test_the_pinned_address_is_asked_by_the_name(receiver: Receiver) -> None:
    target = elsewhere(receiver)
    send(target, b'{"a":1}')
    [(path, headers, body)] = receiver.got
    assert (path, body) == ("/positions", b'{"a":1}')
    assert (headers["Host"], headers["X-Told"]) == (f"hooks.invalid:{target.port}", "yes")
    assert headers["Content-Type"] == "application/json"
    assert headers["User-Agent"].startswith("elfslam/")


@pytest.mark.parametrize(
    ("status", "is_final"),
    [(302, True), (400, True), (410, True), (408, False), (429, False), (503, False)],
)
def test_what_is_no_success_is_told(receiver: Receiver, status: int, is_final: bool) -> None:
    receiver.statuses.append(status)
    with pytest.raises(DeliveryError, match=f"answered {status}") as refused:
        send(elsewhere(receiver))
    assert refused.value.is_final is is_final
    assert len(receiver.got) == 1


def test_nobody_there_is_told() -> None:
    with pytest.raises(DeliveryError, match="cannot be reached") as refused:
        send(target_of(f"http://127.0.0.1:{free_port()}/"))
    assert not refused.value.is_final


async def posted_to(content: bytes, host: str = "http://127.0.0.1", **more: Any) -> None:
    """Post to a server that sends this to whoever has sent a head, and then waits or closes."""
    then_waits, certificate = more.pop("then_waits", True), more.pop("certificate", None)
    writers: list[asyncio.StreamWriter] = []

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(content)
        await writer.drain()
        writers.append(writer)
        if not then_waits:
            writer.close()

    server = await asyncio.start_server(answer, "127.0.0.1", 0, ssl=certificate)
    port = server.sockets[0].getsockname()[1]
    try:
        await post(target_of(f"{host}:{port}/"), "127.0.0.1", b"{}", {}, **more)
    finally:
        server.close()
        for writer in writers:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()


def test_who_says_nothing_is_left_in_time() -> None:
    with pytest.raises(DeliveryError, match=r"did not answer in 0\.2 s"):
        asyncio.run(posted_to(b"HTTP/1.1 200 O", timeout_s=0.2))


@pytest.mark.parametrize("content", [b"", b"HTTP/1.1 2", b"SSH-2.0-OpenSSH\r\n\r\n"])
def test_who_speaks_no_http_is_told(content: bytes) -> None:
    with pytest.raises(DeliveryError, match=r"cannot be reached|without an answer"):
        asyncio.run(posted_to(content, then_waits=False))


def test_an_endless_head_is_not_read_to_its_end() -> None:
    with pytest.raises(DeliveryError, match="cannot be reached"):
        asyncio.run(posted_to(b"HTTP/1.1 200 OK\r\n" + b"X: y\r\n" * 100_000, then_waits=False))


@pytest.mark.parametrize(
    ("name", "trusted"),
    [("hooks.invalid", True), ("other.invalid", True), ("hooks.invalid", False)],
)
def test_over_tls_the_name_is_verified_not_the_address(name: str, trusted: bool) -> None:
    authority, certificate = trustme.CA(), ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert(name).configure_cert(certificate)
    tls = ssl.create_default_context()
    if trusted:
        authority.configure_trust(tls)
    sent = posted_to(
        b"HTTP/1.1 204 No Content\r\n\r\n",
        "https://hooks.invalid",
        certificate=certificate,
        tls=tls,
    )
    is_good = trusted and name == "hooks.invalid"
    refused = pytest.raises(DeliveryError, match="cannot be reached")
    with contextlib.nullcontext() if is_good else refused:
        asyncio.run(sent)


def test_the_receiver_of_the_documentation_checks_what_we_sign() -> None:
    page = (ROOT / "docs" / "how-to" / "positions.md").read_text(encoding="utf-8")
    [code] = re.findall(r"^```python\n(.*?)^```", page, re.S | re.M)
    made: dict[str, Any] = {}
    exec(code.rpartition("HTTPServer(")[0], made)  # its class, without the server on port 8000
    made["Receiver"].log_message = lambda *_: None
    body, now_s = b'{"a":1}', int(time.time())
    with serving(made["Receiver"]) as url:
        for secret, sent_s, is_good in (
            ("SECRET", now_s, True),
            ("OTHER", now_s, False),
            ("SECRET", now_s - 1000, False),
        ):
            told = post(target_of(url), "127.0.0.1", body, signed_headers(secret, sent_s, body))
            with contextlib.nullcontext() if is_good else pytest.raises(DeliveryError, match="403"):
                asyncio.run(told)
