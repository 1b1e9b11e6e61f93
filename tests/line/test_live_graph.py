"""The live graph: what it says as the walk goes on equals what is said of it afterwards."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, chain, compose, wrap_angle
from elfslam.line.graph import GraphParameters, optimise
from elfslam.line.graph.live_graph import Answer, Closure, LiveGraph

PARAMETERS = GraphParameters(noise_rounds=0)
SIGMA = np.array([0.07, 0.035, 0.02])
COVARIANCE = np.diag([0.18, 0.18, 0.18]) ** 2
LAP = 60
TOLERANCE_M = 0.02
"""Poses that moved less than a threshold are not linearised anew, so that a little is left."""


def circle(laps: int) -> F64:
    return chain(np.zeros(3), np.tile([0.7, 0.0, 2 * np.pi / LAP], (laps * LAP, 1)))


def moves_of(truth: F64) -> F64:
    """What dead reckoning makes of it: 3 % short, and turning 0.2 degrees too much a step."""
    return between(truth[:-1], truth[1:]) * [0.97, 1.0, 1.0] + [0.0, 0.0, np.deg2rad(0.2)]


def revisit(truth: F64, i: int, j: int, wrong: F64 | None = None) -> Closure:
    measured = between(truth[i], truth[j])
    return Closure(i, j, measured if wrong is None else compose(measured, wrong), COVARIANCE)


def walked(truth: F64, start: F64 | None = None, *, closing: bool = True) -> LiveGraph:
    live = LiveGraph(truth[0] if start is None else start, PARAMETERS)
    for k, move in enumerate(moves_of(truth), start=1):
        live.step(move, SIGMA)
        if closing and k >= LAP and k % 3 == 0:
            live.close(revisit(truth, k - LAP, k))
    return live


@pytest.fixture(scope="module")
def live() -> LiveGraph:
    return walked(circle(3))


def test_it_equals_solving_everything_at_once(live: LiveGraph) -> None:
    batch = optimise(
        live.graph(), np.arange(len(live)), dataclasses.replace(PARAMETERS, robust=False)
    )
    apart = live.poses() - batch.world_from_body
    npt.assert_allclose(apart[:, :2], 0, atol=TOLERANCE_M)
    npt.assert_allclose(wrap_angle(apart[:, 2]), 0, atol=0.01)
    npt.assert_allclose(live.covariance(len(live) - 1), batch.covariance[-1], rtol=0.05, atol=1e-3)
    assert len(live.believed) > 30


def test_closures_straighten_the_walk(live: LiveGraph) -> None:
    truth = circle(3)
    drifting = chain(truth[0], moves_of(truth))
    before = np.linalg.norm(drifting[:, :2] - truth[:, :2], axis=1).max()
    assert np.linalg.norm(live.poses()[:, :2] - truth[:, :2], axis=1).max() < before / 3


def test_without_closures_it_is_dead_reckoning() -> None:
    truth = circle(1)
    live = walked(truth, closing=False)
    npt.assert_allclose(live.poses(), chain(truth[0], moves_of(truth)), atol=1e-9)
    npt.assert_allclose(live.pose(LAP), live.poses()[-1])
    assert not live.graph().is_closure.any()


def test_moving_the_world_moves_the_answer(live: LiveGraph) -> None:
    move = np.array([5.0, -3.0, 2.0])
    apart = between(compose(move, live.poses()), walked(circle(3), move).poses())
    npt.assert_allclose(apart, 0, atol=TOLERANCE_M)


def test_a_closure_that_does_not_fit_is_refused_and_changes_nothing() -> None:
    truth = circle(2)
    live = walked(truth)
    before, wrong = live.poses(), np.array([15.0, 0.0, 1.0])
    assert live.close(revisit(truth, 10, 110, wrong)) is Answer.REFUSED
    npt.assert_array_equal(live.poses(), before)


def test_a_closure_that_could_be_chance_waits_for_company() -> None:
    truth = circle(1)
    live = walked(truth, closing=False)
    poses, careful = live.poses(), dataclasses.replace(PARAMETERS, least_odds=1e9)
    live.parameters = careful
    answers = [live.close(revisit(truth, k, LAP - 3 + k)) for k in (0, 1, 2)]
    assert answers == [Answer.WAITING, Answer.WAITING, Answer.BELIEVED]
    assert (len(live.believed), len(live.waiting)) == (3, 0)
    assert np.abs(live.poses() - poses).max() > 0.1


def test_those_that_contradict_each_other_keep_waiting() -> None:
    truth = circle(1)
    live = walked(truth, closing=False)
    live.parameters = dataclasses.replace(PARAMETERS, least_odds=1e9)
    for k, forward_m in ((0, -2.0), (1, 0.0), (2, 2.0)):
        answer = live.close(revisit(truth, k, LAP - 3 + k, np.array([forward_m, 0.0, 0.0])))
        assert answer is Answer.WAITING
    npt.assert_allclose(live.poses(), chain(truth[0], moves_of(truth)), atol=1e-9)


def test_what_cannot_be_is_refused(live: LiveGraph) -> None:
    with pytest.raises(InputError, match="joins poses 3 and 500, wanted 0 to 180; add the foot"):
        live.close(Closure(3, 500, np.zeros(3), COVARIANCE))
    with pytest.raises(InputError, match="wanted sigmas of at least 1e-09"):
        live.step(np.zeros(3), np.array([0.1, 0.0, 0.1]))
