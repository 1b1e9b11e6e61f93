"""Bodies that are too large, too slow, silent, or as they should be."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator

import pytest
from starlette.types import Message

from elfslam.serve.people.bodies import Body
from elfslam.serve.problems import Problem

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


def came(pieces: list[Message], pause_s: float, most_bytes: int = 10_000) -> int:
    """How many messages are received until the body or the connection ends. Raises Problem."""
    body = Body(sending(iter(pieces), pause_s), most_bytes, SILENCE_S, PACE)

    async def receive_all() -> int:
        for count in range(1, 1000):
            message = await body.receive()
            if not message.get("more_body", False):
                return count
        raise AssertionError

    return asyncio.run(receive_all())


def refusal(pieces: list[Message], pause_s: float, most_bytes: int = 10_000) -> Problem:
    with pytest.raises(Problem) as refused:
        came(pieces, pause_s, most_bytes)
    return refused.value


def test_silence_is_refused() -> None:
    told = refusal([piece(5000)], 0)
    assert told.status_code == 408
    assert told.headers == {"Connection": "close"}
    assert "go on from the offset" in told.detail


def test_dripping_is_refused_though_no_pause_is_long() -> None:
    pieces = [*[piece(1)] * 20, piece(0, more=False)]
    assert refusal(pieces, SILENCE_S / 8).status_code == 408


def test_what_keeps_the_pace_may_take_long() -> None:
    """Twice as fast as it must be, for twice as long as silence may last."""
    pause_s = SILENCE_S / 10
    pieces = [piece(round(2 * PACE * pause_s))] * 20
    assert came([*pieces, piece(0, more=False)], pause_s) == 21


def test_the_end_of_a_connection_is_waited_for() -> None:
    pieces = iter([piece(1, more=False), GONE])
    body = Body(sending(pieces, 0.75 * SILENCE_S), 10, SILENCE_S, PACE)

    async def whole_then_gone() -> list[Message]:
        first = await body.receive()
        return [first, await asyncio.wait_for(body.receive(), 30)]

    assert asyncio.run(whole_then_gone()) == [piece(1, more=False), GONE]


def test_too_much_is_refused_as_it_comes() -> None:
    assert refusal([piece(60), piece(41)], 0, most_bytes=100).status_code == 413
    assert came([piece(60), piece(40, more=False)], 0, most_bytes=100) == 2
