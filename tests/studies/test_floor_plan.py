"""The study of floor plans, in miniature."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.line.anchoring import AnchoringParameters
from elfslam.scoring.page import Panel
from elfslam.world.simulate import load_world, simulate
from elfslam.world.walkable import standing_room
from studies import floor_plan
from studies.finding import Finding, Given
from studies.floor_plan import Mapped, measure_floor_plan, plan_of
from studies.simulated_walk import SimulatedWalk


@pytest.fixture
def finding(monkeypatch: pytest.MonkeyPatch) -> Finding:
    def as_walked(walk: SimulatedWalk) -> Mapped:
        _, truth = simulate(load_world(walk.world), walk.seed, rounds=1, sound=False)
        xy_m = truth.world_from_body[::20, :2]
        return Mapped((xy_m - xy_m[0]) @ np.array([[0.0, 1.0], [-1.0, 0.0]]), xy_m)

    monkeypatch.setattr(floor_plan, "mapped", as_walked)
    coarse = AnchoringParameters(cell_m=0.2)
    return measure_floor_plan(Given(), worlds={"studio": 1, "lounge": 1}, known=coarse)


def test_each_walk_ends_in_one_way(finding: Finding) -> None:
    rows = {(row["world"], row["plan"]): row for row in finding.rows}
    assert len(rows) == len(finding.rows) == 10
    for row in rows.values():
        assert sum(float(str(row[key])) for key in ("right", "wrong", "ambiguous", "nowhere")) == 1
    furnished = rows["studio", "walls and furniture"]
    assert furnished["right"] == 1
    assert float(str(furnished["error_median_m"])) < 0.5
    assert rows["lounge", "walls and furniture"]["ambiguous"] == 1, "it is the same turned by half"
    assert rows["lounge", "walls and furniture"]["right_among_offered"] == 1
    assert rows["lounge", "walls and furniture, start known"]["right"] == 1
    assert rows["studio", "another floor"]["right"] == 0
    assert finding.page is not None
    assert [panel.title for panel in finding.page.panels] == [
        "studio: OK", "lounge: AMBIGUOUS", "All walks"
    ]  # fmt: skip


def test_a_walk_far_larger_than_the_plan_is_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    far = np.linspace([0.0, 0.0], [300.0, 0.0], 50)
    monkeypatch.setattr(floor_plan, "mapped", lambda walk: Mapped(far, far))
    monkeypatch.setattr(floor_plan, "_panel", lambda walk, parameters: Panel(walk.world, ""))
    rows = measure_floor_plan(Given(), worlds={"studio": 1}).rows
    assert {(row["nowhere"], row["right"], row["error_median_m"]) for row in rows} == {(1, 0, None)}


def test_the_plan_of_a_room_is_free_where_people_can_stand() -> None:
    room = load_world("studio").room
    at = np.random.default_rng(1).uniform([0, 0], [8, 6.5], (400, 2))
    standing = standing_room(room, at)
    assert plan_of(room, furnished=True).holds(at)[standing].all()
    assert plan_of(room, furnished=False).holds(at).mean() > 0.97
    assert plan_of(room, furnished=True).holds(at).mean() < 0.92
