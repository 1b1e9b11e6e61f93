"""Floors of the page in node: those for which the echoes vote in Python."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.slam.floor_location import floors_by_vote
from elfslam.stages.levels import LevelParameters
from tests.in_node import needs_node, passed_in_node

HERE = Path(__file__).parent
EVERY_S = 0.5
"""Half a span is a whole number of these."""


def scene(seed: int, levels: list[int], parameters: LevelParameters) -> dict[str, Any]:
    """Scores of a walk that changes floors now and then, with silence, and what Python votes."""
    generator = np.random.default_rng(seed)
    t_s = EVERY_S * np.arange(400)
    scores = generator.uniform(0.2, 0.4, (len(t_s), len(levels)))
    stays = np.repeat(generator.integers(0, len(levels), 5), len(t_s) // 5)
    scores[np.arange(len(t_s)), stays] += generator.uniform(-0.1, 0.2, len(t_s))
    scores[generator.random(len(t_s)) < 0.1] = np.nan
    scores[160:240] = np.nan
    level, sure = floors_by_vote(t_s, scores, levels, None, parameters)
    return {
        "levels": levels,
        "parameters": {name: asdict(parameters)[name] for name in ("vote_s", "least_lead")},
        "t_s": t_s.tolist(),
        "scores": [[None if np.isnan(each) else each for each in row] for row in scores.tolist()],
        "level": level.tolist(),
        "sure": sure.tolist(),
    }


@needs_node
def test_the_vote_is_that_of_python(tmp_path: Path) -> None:
    known = LevelParameters()
    scenes = [scene(seed, [-1, 0, 1, 2], known) for seed in range(3)]
    scenes += [scene(3, [0, 3], LevelParameters(vote_s=7.0, least_lead=0.1)), scene(4, [2], known)]
    told = {
        (each, sure)
        for one in scenes[:3]
        for each, sure in zip(one["level"], one["sure"], strict=True)
    }
    assert {sure for _, sure in told} == {True, False}
    assert len({each for each, sure in told if sure}) > 2
    file = tmp_path / "floors.json"
    file.write_text(json.dumps(scenes))
    passed_in_node(HERE / "floor_location.test.mjs", ELFSLAM_VECTORS=file)
