"""The board: the last of each walk, for ten seconds, and listeners who may be slow."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable

from elfslam.serve.positions import board as boards
from elfslam.serve.positions.board import Board, Event
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
