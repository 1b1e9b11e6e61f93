"""The demonstration on one walk of its own."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.app.anchor import floor_plan
from elfslam.app.demo import LOCATED, run_demo
from elfslam.data.recordings import read_recording
from elfslam.scoring.truth import read_truth
from elfslam.slam.parameters import Parameters
from elfslam.stages.feature import load_encoder
from elfslam.world.world_file import load_world


@pytest.mark.real
def test_the_demo_maps_locates_and_writes_everything(tmp_path: Path) -> None:
    heard: list[float | None] = []
    given = tmp_path, load_encoder("compact"), Parameters()
    told = {"facts": {}, "announce": lambda what, share: heard.append(share)}
    rows = run_demo(*given, seeds=(500,), **told)
    median, answered = (
        {(row["method"], row["condition"]): float(str(row["value"])) for row in rows
         if row["metric"] == metric}
        for metric in ("median error (m)", "answered")
    )  # fmt: skip
    assert median["SLAM", "aligned"] < 0.4 * median["dead reckoning", "aligned"]
    one_shot, tracked, crossing = ((name, "located") for *_, name in LOCATED)
    assert median[one_shot] < 0.25
    assert median[tracked] < 0.25
    assert answered[tracked] > max(0.9, answered[one_shot])
    assert 0 < answered[crossing] <= 1
    assert len({tuple(row) for row in rows}) == 1  # columns of one table
    assert heard == [0.0, 1.0]
    names = {item.name for item in tmp_path.iterdir() if not item.name.startswith("plotly-")}
    assert names == {"walk", "stranger", "run", "score.html", "fixes.html", "fixes.csv"}
    declared = read_recording(tmp_path / "walk").start_pose
    truth = read_truth(tmp_path / "walk")
    np.testing.assert_allclose(np.asarray(declared), truth.world_from_body[0], atol=1e-6)
    assert ("SLAM", "declared start") in median


def test_the_floor_plan_shows_every_piece_of_furniture() -> None:
    room = load_world("studio").room
    plan = floor_plan(room)
    assert len(plan.obstacles) == len(room.blocks)
    workbench = [[2.2, 2.0], [4.6, 2.0], [4.6, 2.8], [2.2, 2.8]]
    np.testing.assert_allclose(plan.obstacles[0], workbench)
