"""The modules that keep maps, in node, on packages that a real server signed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from starlette.testclient import TestClient

from elfslam.base.values import FloorMap
from elfslam.data.tiles import stretches_of, tiles_of
from tests.data.phone_maps import map_of_parts
from tests.in_node import needs_node, passed_in_node

HERE = Path(__file__).parent


def state_of(client: TestClient, map_id: str, parts: Path) -> dict[str, Any]:
    """A signed package, its parts put into a folder."""
    signed: dict[str, Any] = client.get(f"/api/maps/{map_id}/package").raise_for_status().json()
    told = json.loads(signed["manifest"])
    for part in [*told["tiles"], *told["features"], told["encoder"]]:
        answer = client.get(f"/api/maps/{map_id}/package/{part['sha256']}").raise_for_status()
        (parts / part["sha256"]).write_bytes(answer.content)
    return signed


def wanted(floor_map: FloorMap, file: Path) -> None:
    """What a phone should hold of a map, as one block of float32."""
    tiles = [tile.content for tile in tiles_of(floor_map)]
    stretches = [(each.walk, each.content) for each in stretches_of(floor_map)]
    read = map_of_parts(tiles, stretches, encoder="", sources=("",))
    flat = read.covariance_m2.reshape(-1, 4)[:, [0, 1, 3]]
    columns = (
        read.walk,
        read.order,
        read.xy_m,
        read.heading_rad,
        flat,
        read.weight,
        read.payloads[0].vectors,
    )
    file.write_bytes(np.concatenate([c.ravel() for c in columns]).astype("<f4").tobytes())


@needs_node
def test_the_modules_that_keep_maps(
    owner: TestClient, plant: Callable[[Path], Any], maps: tuple[FloorMap, FloorMap], tmp_path: Path
) -> None:
    parts, first, second = tmp_path / "parts", *maps
    parts.mkdir()
    planted = plant(tmp_path / "data")
    map_id, other = planted.put(first), planted.put(second)
    states = {"first": state_of(owner, map_id, parts), "other": state_of(owner, other, parts)}
    planted.put(second, map_id)
    states["second"] = state_of(owner, map_id, parts)
    told = {**states, "key": owner.get("/api/key").json(), "map": map_id, "otherMap": other}
    (tmp_path / "states.json").write_text(json.dumps(told))
    wanted(first, tmp_path / "first.f32")
    wanted(second, tmp_path / "second.f32")
    passed_in_node(HERE / "keeping.test.mjs", ELFSLAM_PACKAGES=tmp_path)
