"""Ways of the page in node: those that Python finds in the same building."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.building import Passage
from elfslam.base.values import LevelPassage
from elfslam.stages.ways import LevelPosition, Route, way, way_graph
from tests.in_node import needs_node, passed_in_node

HERE = Path(__file__).parent


def building_vectors(seed: int) -> dict[str, Any]:
    """Three floors of random ground, an island on one, passages of every kind, and their ways."""
    generator = np.random.default_rng(seed)
    ground = {level: generator.uniform(-4, 6, (700, 2)) for level in (-1, 0, 1)}
    ground[1] = np.vstack([ground[1], generator.uniform(20, 22, (60, 2))])
    ends = [(a, b) for a, b in generator.uniform(-5, 7, (8, 2)).tolist()]
    joined = zip(
        (LevelPassage.STAIRS, LevelPassage.LIFT, LevelPassage.ESCALATOR, LevelPassage.ESCALATOR),
        ((-1, 0), (-1, 1), (0, 1), (1, 0)),
        ends[::2],
        ends[1::2],
        strict=True,
    )
    passages = [Passage(kind, *levels, a, b, 9.5) for kind, levels, a, b in joined]
    graph, asked = way_graph(ground, passages), []
    for row in generator.uniform(-5, 7, (40, 4)).tolist():
        start, goal = (
            LevelPosition(int(level), (x, y))
            for level, x, y in zip(generator.integers(-1, 2, 2), row[::2], row[1::2], strict=True)
        )
        asked.append((start, goal))
    asked.append((LevelPosition(0, (0.0, 0.0)), LevelPosition(1, (21.0, 21.0))))
    asked.append((LevelPosition(0, (0.0, 0.0)), LevelPosition(0, (0.3, 0.4))))
    return {
        "floors": [{"level": k, "points": xy_m.tolist()} for k, xy_m in ground.items()],
        "passages": [asdict(each) for each in passages],
        "asked": [
            {"start": asdict(one), "goal": asdict(other), "wanted": told(way(graph, one, other))}
            for one, other in asked
        ],
    }


def told(route: Route | None) -> dict[str, Any] | None:
    if route is None:
        return None
    legs = [
        {"level": each.level, "xy_m": each.xy_m.tolist(), "leaves_by": each.leaves_by}
        for each in route.legs
    ]
    return {"length_m": route.length_m, "duration_s": route.duration_s, "legs": legs}


@needs_node
def test_ways_are_those_of_python(tmp_path: Path) -> None:
    vectors, file = building_vectors(7), tmp_path / "ways.json"
    wanted = [each["wanted"] for each in vectors["asked"]]
    assert wanted[-2] is None, "nobody walked to the island"
    assert {len(each["legs"]) for each in wanted if each} >= {1, 2}
    file.write_text(json.dumps(vectors))
    passed_in_node(HERE / "ways.test.mjs", ELFSLAM_VECTORS=file)
