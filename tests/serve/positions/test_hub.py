"""The board: the last of each walk, for ten seconds, and listeners, who may be slow."""

import asyncio
import json
import signal
import threading
from collections.abc import Awaitable, Callable
from typing import Any

import httpx
import pytest

from elfslam.serve.positions import hub as boards
from elfslam.serve.positions.hub import BEAT, BEGIN, Board, Event, stream_of, written
from tests.serve.conftest import Maps
from tests.serve.planting import plant_floor_map
from tests.serve.positions.conftest import position

MAP = "a" * 32


def test_each_walk_shows_its_last_position_by_name() -> None:
    board = Board()
    board.tell([position(x_m=1.0), position(x_m=3.0), position(name="Aaron", walk="c" * 8)])
    assert [(each.name, each.x_m) for each in board.there(MAP)] == [("Aaron", 1.0), ("Ada", 3.0)]
    assert board.there("f" * 32) == []


def test_who_tells_nothing_is_shown_no_more() -> None:
    now_s = [0.0]
    board = Board(lambda: now_s[0])
    board.tell([position()])
    now_s[0] = boards.LASTS_S
    assert len(board.there(MAP)) == 1
    now_s[0] += 0.01
    assert board.there(MAP) == []


def test_a_walker_leaves_with_one_walk_or_with_all() -> None:
    board = Board()
    board.tell([position(), position(walk="c" * 8), position(walker="d" * 32, walk="d" * 8)])
    board.leave("b" * 32, "c" * 8)
    assert len(board.there(MAP)) == 2
    board.leave("b" * 32)
    assert [each.walker for each in board.there(MAP)] == ["d" * 32]
    board.clear(MAP)
    assert board.there(MAP) == []


def test_one_walker_fills_no_board() -> None:
    board = Board()
    board.tell([position(walk=f"{k:08x}") for k in range(boards.MOST_WALKS + 5)])
    board.tell([position(walker="d" * 32)])
    mine = [each.walk for each in board.there(MAP) if each.walker == "b" * 32]
    assert mine == [f"{k:08x}" for k in range(5, boards.MOST_WALKS + 5)]


@pytest.mark.anyio
async def test_a_listener_hears_of_their_map_alone() -> None:
    board, events = Board(), list[Event]()
    with board.listening(MAP, "u") as listener:
        await asyncio.to_thread(board.tell, [position(), position(map="f" * 32)])
        await asyncio.to_thread(board.leave, "b" * 32, None)
        while len(events) < 2:
            events += await listener.take(60)
        assert board.listeners_of("u") == 1
    assert board.listeners_of("u") == 0
    told, gone = events
    assert (told.kind, json.loads(told.data)["x_m"]) == ("position", 1.0)
    who = {"walker": "b" * 32, "walk": position().walk}
    assert (gone.kind, json.loads(gone.data)) == ("gone", who)


@pytest.mark.anyio
async def test_a_slow_listener_loses_the_oldest_and_keeps_nobody_waiting() -> None:
    board = Board()
    with board.listening(MAP, "u") as listener:
        board.tell([position(x_m=float(k)) for k in range(boards.MOST_WAITING + 3)])
        events = await listener.take(60)
    assert len(events) == boards.MOST_WAITING
    assert json.loads(events[0].data)["x_m"] == 3.0


@pytest.mark.anyio
async def test_nothing_is_heard_where_nothing_is_told() -> None:
    with Board().listening(MAP, "u") as listener:
        assert await listener.take(0.001) == []


async def allowed() -> bool:
    return True


async def refused() -> bool:
    return False


def test_events_are_written_as_the_standard_says() -> None:
    assert written([Event("gone", '{"walk":"a"}')]) == b'event: gone\ndata: {"walk":"a"}\n\n'
    assert written([]) == b""


@pytest.mark.anyio
async def test_a_stream_begins_with_who_is_there_and_goes_on() -> None:
    board = Board()
    board.tell([position(x_m=7.0)])
    stream = stream_of(board, MAP, "u", allowed, beat_s=60)
    first = await anext(stream)
    board.tell([position(x_m=8.0)])
    second = await anext(stream)
    await stream.aclose()
    assert board.listeners_of("u") == 0
    assert first.startswith(BEGIN)
    assert b'"x_m":7.0' in first
    assert second.startswith(b"event: position\ndata: {")
    assert b'"x_m":8.0' in second


@pytest.mark.anyio
@pytest.mark.parametrize(("may", "wanted"), [(allowed, [BEGIN, BEAT, BEAT]), (refused, [BEGIN])])
async def test_in_silence_it_beats_as_long_as_access_lasts(
    may: Callable[[], Awaitable[bool]], wanted: list[bytes]
) -> None:
    stream, pieces = stream_of(Board(), MAP, "u", may, beat_s=0.001), list[bytes]()
    async for piece in stream:
        pieces.append(piece)
        if len(pieces) == 3:
            await stream.aclose()
            break
    assert pieces == wanted


@pytest.mark.anyio
async def test_a_server_that_stops_ends_its_streams() -> None:
    board = Board()
    stream = stream_of(board, MAP, "u", allowed, beat_s=60)
    assert await anext(stream) == BEGIN
    board.close()
    async for _ in stream:
        pass


async def _first(stream, count):  # type: ignore[no-untyped-def]
    async for piece in stream:
        yield piece
        count -= 1
        if not count:
            await stream.aclose()
            return


Start = Callable[..., Any]
PATIENCE_S = 60.0


@pytest.mark.real
def test_a_listener_hears_and_a_stop_ends_the_stream(start_server: Start, maps: Maps) -> None:
    server = start_server()
    map_id = plant_floor_map(server.data, maps[0])
    address = f"/api/maps/{map_id}/positions"
    lines: list[str] = []
    heard = threading.Event()

    def listen() -> None:
        with (
            httpx.Client(base_url=server.url, headers=server.bearer, timeout=PATIENCE_S) as client,
            client.stream("GET", f"{address}/stream") as answer,
        ):
            assert answer.headers["content-type"].startswith("text/event-stream")
            for line in answer.iter_lines():
                lines.append(line)
                heard.set()

    thread = threading.Thread(target=listen)
    thread.start()
    assert heard.wait(PATIENCE_S)
    sent = {"map": map_id, "walk": "0" * 16, "positions": [{"status": "OK", "x_m": 1, "y_m": 2}]}
    with httpx.Client(base_url=server.url, headers=server.bearer, timeout=PATIENCE_S) as client:
        heard.clear()
        assert client.post("/api/positions", json=sent).status_code == 204
        assert heard.wait(PATIENCE_S)
        assert client.get(address).json()[0]["x_m"] == 1.0
    server.process.send_signal(signal.SIGTERM)
    assert server.process.wait(PATIENCE_S) in (0, -signal.SIGTERM)
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
    told = [json.loads(line.partition(" ")[2]) for line in lines if line.startswith("data:")]
    assert [each["x_m"] for each in told] == [1.0]
