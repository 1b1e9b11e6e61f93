"""Server-sent events: who is there, what comes, and when a stream ends."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from elfslam.serve.positions.board import Board, Event
from elfslam.serve.positions.streaming import BEAT, BEGIN, stream_of, written
from elfslam.serve.positions.values import LivePosition

Made = Callable[..., LivePosition]
MAP = "a" * 32


async def allowed() -> bool:
    return True


async def refused() -> bool:
    return False


def test_events_are_written_as_the_standard_says() -> None:
    assert written([Event("gone", '{"walk":"a"}')]) == b'event: gone\ndata: {"walk":"a"}\n\n'
    assert written([]) == b""


def test_a_stream_begins_with_who_is_there_and_goes_on(position: Made) -> None:
    async def heard() -> list[bytes]:
        board = Board()
        board.tell([position(x_m=7.0)])
        stream = stream_of(board, MAP, "u", allowed, beat_s=60)
        pieces = [await anext(stream)]
        board.tell([position(x_m=8.0)])
        pieces.append(await anext(stream))
        await stream.aclose()
        assert board.listeners_of("u") == 0
        return pieces

    first, second = asyncio.run(heard())
    assert first.startswith(BEGIN)
    assert b'"x_m":7.0' in first
    assert second.startswith(b"event: position\ndata: {")
    assert b'"x_m":8.0' in second


def test_in_silence_it_beats_as_long_as_access_lasts() -> None:
    async def heard(may: Callable[..., object]) -> list[bytes]:
        stream = stream_of(Board(), MAP, "u", may, beat_s=0.001)  # type: ignore[arg-type]
        return [piece async for piece in _first(stream, 3)]

    assert asyncio.run(heard(allowed)) == [BEGIN, BEAT, BEAT]
    assert asyncio.run(heard(refused)) == [BEGIN]


def test_a_server_that_stops_ends_its_streams() -> None:
    async def heard() -> list[bytes]:
        board = Board()
        stream = stream_of(board, MAP, "u", allowed, beat_s=60)
        pieces = [await anext(stream)]
        board.close()
        return pieces + [piece async for piece in stream]

    assert asyncio.run(heard())[0] == BEGIN


async def _first(stream, count):  # type: ignore[no-untyped-def]
    async for piece in stream:
        yield piece
        count -= 1
        if not count:
            await stream.aclose()
            return
