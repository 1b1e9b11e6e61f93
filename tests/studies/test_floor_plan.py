"""The study of floor plans, in miniature."""

import numpy as np
import pytest

from elfslam.stages.floor_plan_alignment import AnchoringParameters
from elfslam.world.room import standing_room
from elfslam.world.simulate import load_world, simulate
from studies import floor_plan
from studies.cached import SimulatedWalk
from studies.floor_plan import ERROR, REFUSED, RIGHT, UNSURE, Mapped, measure_floor_plan, plan_of
from studies.study import StudyContext


def test_each_walk_ends_in_one_way(monkeypatch: pytest.MonkeyPatch) -> None:
    def as_walked(walk: SimulatedWalk) -> Mapped:
        _, truth = simulate(load_world(walk.world), walk.seed, rounds=1, sound=False)
        xy_m = truth.world_from_body[::20, :2]
        return Mapped((xy_m - xy_m[0]) @ np.array([[0.0, 1.0], [-1.0, 0.0]]), xy_m)

    monkeypatch.setattr(floor_plan, "mapped", as_walked)
    coarse = AnchoringParameters(cell_m=0.2)
    records = measure_floor_plan(StudyContext(), worlds={"studio": 1, "lounge": 1}, known=coarse)
    found = {(r.world, r.condition, r.metric): r.value for r in records}
    for world, plan in {key[:2] for key in found}:
        ways = (RIGHT, floor_plan.WRONG, UNSURE, REFUSED)
        assert sum(found[world, plan, way] for way in ways) == 1
    assert found["studio", "walls and furniture", RIGHT] == 1
    assert found["studio", "walls and furniture", ERROR] < 0.5
    assert found["lounge", "walls and furniture", UNSURE] == 1, "it is the same turned by half"
    assert found["lounge", "walls and furniture", floor_plan.OFFERED] == 1
    assert found["lounge", "walls and furniture, known start", RIGHT] == 1
    assert found["studio", "another floor", RIGHT] == 0


def test_a_walk_far_larger_than_the_plan_is_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    far = np.linspace([0.0, 0.0], [300.0, 0.0], 50)
    monkeypatch.setattr(floor_plan, "mapped", lambda walk: Mapped(far, far))
    records = measure_floor_plan(StudyContext(), worlds={"studio": 1})
    assert {r.value for r in records if r.metric == REFUSED} == {1}
    assert {r.value for r in records if r.metric == RIGHT} == {0}
    assert ERROR not in {r.metric for r in records}


def test_the_plan_of_a_room_is_free_where_people_can_stand() -> None:
    room = load_world("studio").room
    at = np.random.default_rng(1).uniform([0, 0], [8, 6.5], (400, 2))
    standing = standing_room(room, at)
    assert plan_of(room, furnished=True).holds(at)[standing].all()
    assert plan_of(room, furnished=False).holds(at).mean() > 0.97
    assert plan_of(room, furnished=True).holds(at).mean() < 0.92
