"""A real server: a listener hears a walker, and a stop waits for no listener."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from elfslam.base.values import FloorMap

pytestmark = pytest.mark.real
Start = Callable[..., Any]
PATIENCE_S = 60.0


def test_a_listener_hears_and_a_stop_ends_the_stream(
    start_server: Start, plant: Start, maps: tuple[FloorMap, FloorMap]
) -> None:
    server = start_server()
    map_id = plant(server.data).put(maps[0])
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
