"""Server-sent events of a map's live positions (HTML standard, section 9.2)."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Awaitable, Callable

from elfslam.serve.positions.board import Board, Event

BEAT_S = 15.0
"""Without anything to tell, a comment comes so often; and so often it is asked who may listen."""
BEAT = b":\n\n"
BEGIN = b"retry: 3000\n\n"
MEDIA_TYPE = "text/event-stream"


async def stream_of(
    board: Board,
    map_id: str,
    user_id: str,
    may_listen: Callable[[], Awaitable[bool]],
    *,
    beat_s: float = BEAT_S,
) -> AsyncIterator[bytes]:
    """Who is there, then every position as it comes, until the server stops or access ends."""
    with board.listening(map_id, user_id) as listener:
        there = [Event("position", each.model_dump_json()) for each in board.there(map_id)]
        yield BEGIN + written(there)
        asked_s = time.monotonic()
        while not board.is_closed:
            events = await listener.take(beat_s)
            if time.monotonic() - asked_s >= beat_s:
                asked_s = time.monotonic()
                if not await may_listen():
                    return
            yield written(events) or BEAT


def written(events: list[Event]) -> bytes:
    """Events as they are sent."""
    return "".join(f"event: {each.kind}\ndata: {each.data}\n\n" for each in events).encode()
