"""Webhooks: batches, tries, rests and what is dropped; and the whole way to a receiver."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import timedelta
from typing import Any

import pytest
from starlette.testclient import TestClient

from elfslam.base.errors import InputError
from elfslam.serve.positions.delivery import DeliveryError
from elfslam.serve.positions.outboxes import MOST_WAITING, Outboxes
from elfslam.serve.positions.signature import SIGNATURE, TIMESTAMP, digest
from elfslam.serve.positions.targets import Target
from elfslam.serve.positions.values import LivePosition
from elfslam.serve.positions.webhooks import MOST_AT_ONCE, PAUSES_S, Hook, WebhookDispatcher
from elfslam.serve.settings import ServerSettings
from tests.serve.positions.conftest import Receiver
from tests.waiting import until

Made = Callable[..., LivePosition]
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

    def round(self, postman: WebhookDispatcher) -> Any:
        async def both() -> None:
            await postman.dispatch()
            await postman.finish()

        return both()


def run_rounds(world: World, *batches: list[LivePosition]) -> None:
    """A round after each batch, a minute apart."""

    async def rounds() -> None:
        postman = world.postman()
        for batch in batches:
            world.outboxes.put(batch)
            await world.round(postman)
            world.now_s += 60

    asyncio.run(rounds())


def test_positions_of_a_map_go_to_its_webhook_in_one_batch(position: Made) -> None:
    world = World()
    run_rounds(world, [position(x_m=1.0), position(x_m=2.0), position(map="f" * 32)])
    [(target, address, body, _)] = world.got
    assert (target.url, address) == ("https://h/p", "93.184.216.34")
    assert body["map"] == MAP
    assert [each["x_m"] for each in body["positions"]] == [1.0, 2.0]
    told = world.outboxes.deliveries_of("h")
    assert (told.delivered, told.dropped, told.last_error) == (2, 0, None)
    assert told.last_delivered_utc is not None


def test_it_is_tried_three_times_and_then_dropped_and_said(position: Made) -> None:
    world = World(answers=[AWAY, AWAY, AWAY])
    run_rounds(world, [position()], [position(x_m=5.0)])
    assert len(world.got) == 4
    assert world.pauses_s == list(PAUSES_S)
    told = world.outboxes.deliveries_of("h")
    assert (told.delivered, told.dropped) == (1, 1)
    assert told.last_error is None, "the last delivery went well"


def test_the_last_error_is_told_until_it_goes_well(position: Made) -> None:
    world = World(answers=3 * [AWAY])
    run_rounds(world, [position()])
    told = world.outboxes.deliveries_of("h")
    assert (told.last_error, told.delivered) == ("answered 503", 0)
    assert told.last_error_utc is not None
    world.outboxes.forget("h")
    assert world.outboxes.deliveries_of("h").last_error is None


def test_what_is_refused_for_good_is_not_tried_again(position: Made) -> None:
    world = World(answers=[DeliveryError("answered 410", is_final=True)])
    run_rounds(world, [position()])
    assert len(world.got) == 1
    assert world.outboxes.deliveries_of("h").dropped == 1


def test_a_name_that_has_moved_inside_is_not_asked(position: Made) -> None:
    world = World(address=InputError("webhook h: leads to 10.0.0.7, which is not public"))
    run_rounds(world, [position()])
    assert world.got == []
    assert "10.0.0.7" in str(world.outboxes.deliveries_of("h").last_error)


def test_after_a_failure_it_rests_ever_longer(position: Made) -> None:
    async def rounds(world: World) -> list[int]:
        postman, seen = world.postman(), []
        for now_s in (0.0, 1.9, 2.0, 5.9, 6.0):
            world.now_s = now_s
            world.outboxes.put([position()])
            await world.round(postman)
            seen.append(len(world.got))
        return seen

    final = DeliveryError("answered 500", is_final=True)
    assert asyncio.run(rounds(World(answers=9 * [final]))) == [1, 1, 2, 2, 3]


def test_a_queue_is_bounded_and_batches_too(position: Made) -> None:
    world = World()
    run_rounds(world, [position(x_m=float(k)) for k in range(MOST_WAITING + 7)], [], [])
    sizes = [len(body["positions"]) for _, _, body, _ in world.got]
    assert sizes == 3 * [MOST_AT_ONCE]
    assert world.got[0][2]["positions"][0]["x_m"] == 7.0


def test_what_came_while_it_rested_is_counted_as_dropped(position: Made) -> None:
    world = World(answers=[DeliveryError("answered 500", is_final=True)])

    async def rounds() -> None:
        postman = world.postman()
        for count in (1, MOST_WAITING, 3):
            world.outboxes.put(count * [position()])
            await world.round(postman)

    asyncio.run(rounds())
    assert world.outboxes.deliveries_of("h").dropped == 1 + 3


def test_what_a_walker_deletes_while_it_waits_is_not_passed_on(position: Made) -> None:
    world = World(answers=[DeliveryError("answered 500", is_final=True)])

    async def rounds() -> None:
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

    asyncio.run(rounds())
    assert [each["x_m"] for each in world.got[-1][2]["positions"]] == [9.0, 7.0]
    assert world.outboxes.deliveries_of("h").delivered == 2


def test_where_nothing_is_left_nothing_is_posted(position: Made) -> None:
    world = World()
    world.outboxes.forget_walker("b" * 32, position().time_utc)
    run_rounds(world, [position(time_utc=position().time_utc - timedelta(seconds=9))])
    assert world.got == []


def test_a_slow_webhook_keeps_no_other_waiting(position: Made) -> None:
    async def rounds() -> list[str]:
        stuck, arrived = asyncio.Event(), []

        async def send(target: Target, *_: object) -> None:
            if target.host == "slow":
                await stuck.wait()
            arrived.append(target.host)

        hooks = [Hook("s", MAP, "http://slow/", SECRET), Hook("q", MAP, "http://quick/", SECRET)]
        outboxes = Outboxes()
        postman = WebhookDispatcher(
            outboxes, lambda _maps: hooks, lambda _target: "93.184.216.34", send
        )
        for k in range(2):
            outboxes.put([position()])
            while len(arrived) <= k:
                await postman.dispatch()
                await asyncio.sleep(0.001)
        before = list(arrived)
        stuck.set()
        await postman.finish()
        return before

    assert asyncio.run(rounds()) == ["quick", "quick"]


def test_a_deleted_webhook_gets_nothing_more(position: Made) -> None:
    world = World(answers=[DeliveryError("answered 500", is_final=True)])

    async def rounds() -> None:
        postman = world.postman()
        for hooks in (world.hooks, world.hooks, []):
            world.hooks = hooks
            world.outboxes.put([position()])
            await world.round(postman)
        world.now_s = 1000.0
        world.outboxes.put([position()])
        await world.round(postman)

    asyncio.run(rounds())
    assert len(world.got) == 1


@pytest.mark.real
class TestTheWholeWay:
    """A server that may post to this machine, and a receiver there."""

    @pytest.fixture
    def settings(self, settings: ServerSettings) -> ServerSettings:
        return replace(settings, local_webhooks=True)

    def test_positions_arrive_signed(
        self,
        owner: TestClient,
        map_id: str,
        receiver: Receiver,
        message: Callable[..., dict[str, Any]],
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
        self,
        owner: TestClient,
        map_id: str,
        receiver: Receiver,
        message: Callable[..., dict[str, Any]],
    ) -> None:
        hooks = f"/api/maps/{map_id}/webhooks"
        receiver.statuses.append(410)
        owner.post(hooks, json={"url": receiver.url})
        owner.post("/api/positions", json=message())
        until(lambda: owner.get(hooks).json()[0]["last_error"] == "answered 410", "the error")
        assert owner.get(hooks).json()[0]["dropped"] == 1
