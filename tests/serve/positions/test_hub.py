"""The board: the last of each walk, for ten seconds, and listeners who may be slow."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable

from elfslam.serve.positions import hub as boards
from elfslam.serve.positions.hub import BEAT, BEGIN, Board, Event, stream_of, written
from elfslam.serve.positions.values import LivePosition

Made = Callable[..., LivePosition]
MAP = "a" * 32


def test_each_walk_shows_its_last_position_by_name(position: Made) -> None:
    board = Board()
    board.tell([position(x_m=1.0), position(x_m=3.0), position(name="Aaron", walk="c" * 8)])
    assert [(each.name, each.x_m) for each in board.there(MAP)] == [("Aaron", 1.0), ("Ada", 3.0)]
    assert board.there("f" * 32) == []


def test_who_tells_nothing_is_shown_no_more(position: Made) -> None:
    now_s = [0.0]
    board = Board(lambda: now_s[0])
    board.tell([position()])
    now_s[0] = boards.LASTS_S
    assert len(board.there(MAP)) == 1
    now_s[0] += 0.01
    assert board.there(MAP) == []


def test_a_walker_leaves_with_one_walk_or_with_all(position: Made) -> None:
    board = Board()
    board.tell([position(), position(walk="c" * 8), position(walker="d" * 32, walk="d" * 8)])
    board.leave("b" * 32, "c" * 8)
    assert len(board.there(MAP)) == 2
    board.leave("b" * 32)
    assert [each.walker for each in board.there(MAP)] == ["d" * 32]
    board.clear(MAP)
    assert board.there(MAP) == []


def test_one_walker_fills_no_board(position: Made) -> None:
    board = Board()
    board.tell([position(walk=f"{k:08x}") for k in range(boards.MOST_WALKS + 5)])
    board.tell([position(walker="d" * 32)])
    mine = [each.walk for each in board.there(MAP) if each.walker == "b" * 32]
    assert mine == [f"{k:08x}" for k in range(5, boards.MOST_WALKS + 5)]


def test_a_listener_hears_of_their_map_alone(position: Made) -> None:
    async def heard() -> list[Event]:
        board = Board()
        with board.listening(MAP, "u") as listener:
            await asyncio.to_thread(board.tell, [position(), position(map="f" * 32)])
            await asyncio.to_thread(board.leave, "b" * 32, None)
            events = []
            while len(events) < 2:
                events += await listener.take(60)
            assert board.listeners_of("u") == 1
        assert board.listeners_of("u") == 0
        return events

    told, gone = asyncio.run(heard())
    assert (told.kind, json.loads(told.data)["x_m"]) == ("position", 1.0)
    assert (gone.kind, json.loads(gone.data)) == (
        "gone",
        {"walker": "b" * 32, "walk": position().walk},
    )


def test_a_slow_listener_loses_the_oldest_and_keeps_nobody_waiting(position: Made) -> None:
    async def heard() -> list[Event]:
        board = Board()
        with board.listening(MAP, "u") as listener:
            board.tell([position(x_m=float(k)) for k in range(boards.MOST_WAITING + 3)])
            return await listener.take(60)

    events = asyncio.run(heard())
    assert len(events) == boards.MOST_WAITING
    assert json.loads(events[0].data)["x_m"] == 3.0


def test_nothing_is_heard_where_nothing_is_told() -> None:
    async def heard() -> list[Event]:
        with Board().listening(MAP, "u") as listener:
            return await listener.take(0.001)

    assert asyncio.run(heard()) == []


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
