"""Outlier rejection of closures: pairwise consistency, order, single ones, further senses."""

import dataclasses

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, chain, compose
from elfslam.base.values import NO_CLOSURES, Closures, Odometry, PoseGraph
from elfslam.stages import graph as graphs
from elfslam.stages.graph import agreeing, build_graph, expected, optimise, solving, uncertainty
from elfslam.stages.graph.blocks import pattern_of
from elfslam.stages.graph.building import believing, edges_of

PARAMETERS = graphs.GraphParameters(noise_rounds=0)
LAP = 80
SIGMA = np.array([0.07, 0.035, 0.02])
CLOSURE_SIGMA = np.array([0.18, 0.18, 0.18])
LIMIT = 11.34


@pytest.fixture(scope="module")
def truth() -> F64:
    """Three rounds of a circle of 56 m."""
    return chain(np.zeros(3), np.tile([0.7, 0.0, 2 * np.pi / LAP], (3 * LAP, 1)))


@pytest.fixture(scope="module")
def nodes(truth: F64) -> Odometry:
    noise = np.random.default_rng(0).normal(size=(3 * LAP, 3)) * SIGMA
    moves = between(truth[:-1], truth[1:]) + noise
    return Odometry(np.arange(len(truth)), chain(truth[0], moves), np.tile(SIGMA, (len(moves), 1)))


def graph_of(nodes: Odometry, i: I64, j: I64, i_from_j: F64) -> PoseGraph:
    covariance = np.tile(np.diag(CLOSURE_SIGMA**2), (len(i), 1, 1))
    return build_graph(nodes, Closures(i, j, np.ones(len(i)), i_from_j, covariance))


def revisits(truth: F64, i: I64, j: I64, seed: int = 1) -> F64:
    noise = np.random.default_rng(seed).normal(size=(len(i), 3)) * CLOSURE_SIGMA
    return compose(between(truth[i], truth[j]), noise)


def test_dead_reckoning_is_as_uncertain_as_its_equations_say(nodes: Odometry) -> None:
    i, j = np.array([0, 50, 130]), np.array([30, 57, 90])
    graph = graph_of(nodes, i, j, np.zeros((3, 3)))
    steps = believing(graph, np.zeros(3, dtype=bool))
    chain_ = solving.chain_of(graph)
    poses = nodes.world_from_body
    equations = uncertainty.equations_at(steps, poses, pattern_of(graph.edges, len(poses)), 1e-3)
    moves = between(poses[i], poses[j])
    known = uncertainty.marginal_covariances(equations)
    wanted = uncertainty.predicted_covariance(known, poses, np.column_stack([i, j]), moves)
    npt.assert_allclose(solving.chain_covariance(chain_, i, j), wanted, rtol=1e-5, atol=1e-9)


def test_company_is_kept_by_those_that_agree(truth: F64, nodes: Odometry) -> None:
    i = np.array([3, 4, 5, 6, 30])
    j = i + LAP
    moves = revisits(truth, i, j)
    moves[3] = compose(moves[3], np.array([3.0, 0.0, 0.0]))
    graph = graph_of(nodes, i, j, moves)
    closures = solving.forward(edges_of(graph, graph.is_closure))
    pairs, agree = solving.agreeing_pairs(solving.chain_of(graph), closures, 10, LIMIT)
    assert {tuple(pair) for pair in pairs} == {(a, b) for a in range(4) for b in range(a + 1, 4)}
    npt.assert_array_equal(agree, [3 not in pair for pair in pairs])
    runs = solving.find_runs(solving.chain_of(graph), closures, 10, LIMIT)
    npt.assert_array_equal(runs.size[runs.run], [3, 3, 3, 1, 1])


def test_looking_back_is_looking_forward(truth: F64, nodes: Odometry) -> None:
    i = np.arange(10, 14)
    moves = revisits(truth, i, i + LAP)
    ahead = graph_of(nodes, i, i + LAP, moves)
    turned = np.flatnonzero(ahead.is_closure)[1:3]
    edges, measured = ahead.edges.copy(), ahead.measurements.copy()
    edges[turned] = edges[turned, ::-1]
    measured[turned] = between(measured[turned], np.zeros(3))
    back = dataclasses.replace(ahead, edges=edges, measurements=measured)
    one, other = (solving.forward(edges_of(graph, graph.is_closure)) for graph in (ahead, back))
    npt.assert_array_equal(one.low, other.low)
    npt.assert_allclose(one.low_from_high, other.low_from_high, atol=1e-12)
    solved = [optimise(graph, nodes.t_s, PARAMETERS) for graph in (ahead, back)]
    npt.assert_array_equal(solved[0].closure_weights, solved[1].closure_weights)


def test_a_wrong_run_falls_once_the_short_loops_are_closed(truth: F64, nodes: Odometry) -> None:
    """It is as long as the right ones and agrees with itself; dead reckoning alone allows it."""
    right = np.arange(0, 60, 4)
    wrong = np.arange(20, 26)
    i = np.concatenate([right, right + LAP, wrong])
    j = np.concatenate([right + LAP, right + 2 * LAP, wrong + 2 * LAP])
    moves = revisits(truth, i, j)
    moves[-6:] = compose(moves[-6:], np.array([1.6, 0.4, 0.0]))
    graph = graph_of(nodes, i, j, moves)
    alone = graph_of(nodes, i[-6:], j[-6:], moves[-6:])
    assert optimise(alone, nodes.t_s, PARAMETERS).closure_weights.mean() > 0.8
    solved = optimise(graph, nodes.t_s, PARAMETERS)
    npt.assert_array_equal(solved.closure_weights[-6:], 0.0)
    assert solved.closure_weights[:-6].mean() > 0.9


def test_a_closure_is_believed_where_chance_would_not_hit(truth: F64, nodes: Odometry) -> None:
    near, far = np.array([[10], [25]]), np.array([[10], [10 + 2 * LAP]])
    for (i, j), believed in ((near, True), (far, False)):
        graph = graph_of(nodes, i, j, revisits(truth, i, j))
        _, kept = solving.choose_closures(graph, PARAMETERS)
        assert kept.tolist() == [believed]


def test_an_uncertain_heading_bends_the_way() -> None:
    covariance = np.diag([0.01, 4.0, 0.25])[None]
    widened = solving.second_order_inflated(covariance)[0]
    npt.assert_allclose(np.diag(widened), [0.01 + 0.25 * 4.01 / 4, 4 + 0.25 * 4.01 / 4, 0.25])
    inflated = solving.second_order_inflated(np.diag([1e-4, 1e-4, 1e-8])[None])
    npt.assert_allclose(inflated[0][0, 0], 1e-4, rtol=1e-6)


def test_moving_the_world_changes_no_choice(truth: F64, nodes: Odometry) -> None:
    i = np.arange(0, 60, 3)
    moves = revisits(truth, i, i + LAP)
    moves[::4] = compose(moves[::4], np.array([4.0, 0.0, 0.5]))
    moved = compose(np.array([40.0, -9.0, 2.5]), nodes.world_from_body)
    there = dataclasses.replace(nodes, world_from_body=moved)
    both = [graph_of(each, i, i + LAP, moves) for each in (nodes, there)]
    here, away = (optimise(graph, nodes.t_s, PARAMETERS) for graph in both)
    npt.assert_array_equal(here.closure_weights, away.closure_weights)
    assert 0 < here.closure_weights.sum() < len(i)


def test_steps_that_are_no_chain_are_refused(truth: F64, nodes: Odometry) -> None:
    i = np.arange(3)
    graph = graph_of(nodes, i, i + LAP, revisits(truth, i, i + LAP))
    broken = dataclasses.replace(graph, is_closure=np.arange(len(graph.edges)) >= 3 * LAP - 1)
    with pytest.raises(InputError, match="239 steps do not lead through its 241 poses one by one"):
        optimise(broken, nodes.t_s, PARAMETERS)


def measured(i: I64, j: I64, i_from_j: F64, sigma: F64 = CLOSURE_SIGMA) -> Closures:
    return Closures(i, j, np.ones(len(i)), i_from_j, np.tile(np.diag(sigma**2), (len(i), 1, 1)))


def test_what_another_sense_says_must_fit_the_straight_walk(truth: F64, nodes: Odometry) -> None:
    i = np.arange(0, LAP, 4)
    straight = build_graph(nodes, measured(i, i + LAP, revisits(truth, i, i + LAP)))
    i = np.arange(2, LAP, 8)
    right = revisits(truth, i, i + LAP)
    wrong = compose(right, np.array([1.5, 0.0, 0.0]))
    before = build_graph(nodes, NO_CLOSURES)
    assert agreeing(straight, measured(i, i + LAP, right), PARAMETERS).mean() > 0.7
    assert not agreeing(straight, measured(i, i + LAP, wrong), PARAMETERS).any()
    assert agreeing(before, measured(i, i + LAP, wrong), PARAMETERS).all()


def test_a_sense_of_metres_need_not_fit_to_centimetres(truth: F64, nodes: Odometry) -> None:
    i = np.arange(0, LAP, 4)
    straight = build_graph(nodes, measured(i, i + LAP, revisits(truth, i, i + LAP)))
    off = compose(between(truth[i], truth[i + LAP]), np.array([1.5, 0.0, 0.0]))
    coarse = measured(i, i + LAP, off, np.array([3.0, 3.0, 1.0]))
    assert agreeing(straight, coarse, PARAMETERS).all()


def test_solutions_expect_what_is_true_and_exclude_the_rest(truth: F64, nodes: Odometry) -> None:
    i = np.arange(0, LAP, 4)
    straight = build_graph(nodes, measured(i, i + LAP, revisits(truth, i, i + LAP)))
    there = between(truth[i], truth[i + LAP])
    odds, _ = expected(straight, measured(i, i + LAP, there), PARAMETERS)
    off = measured(i, i + LAP, compose(there, np.array([2.5, 0.0, 0.0])))
    wrong, gain = expected(straight, off, PARAMETERS)
    assert (odds > 3).all()
    assert np.isneginf(wrong).all()
    assert (gain >= 0).all()


def test_a_closure_brings_what_the_solution_did_not_know(truth: F64, nodes: Odometry) -> None:
    """Half the logarithm of by how much it raises the determinant of the information matrix."""
    i = np.arange(0, 40, 2)
    known = measured(i, i + LAP, between(truth[i], truth[i + LAP]))
    graph, i, j = build_graph(nodes, known), np.array([10, 70]), np.array([91, 230])
    asked = measured(i, j, between(truth[i], truth[j]))
    _, gain = expected(graph, asked, PARAMETERS)
    solved, kept = solving.choose_closures(graph, PARAMETERS)
    edges, believed = np.column_stack([i, j]), believing(graph, kept)
    pattern = pattern_of(np.vstack([believed.edges, edges]), len(truth))
    equations = uncertainty.equations_at(believed, solved, pattern, 1e-3)
    marginal = uncertainty.marginal_covariances(equations)
    predicted = uncertainty.predicted_covariance(marginal, solved, edges, asked.i_from_j)
    raised = np.linalg.det(np.eye(3) + predicted @ np.linalg.inv(asked.covariance))
    npt.assert_allclose(gain, np.log(raised) / 2, atol=0.1)
    assert gain[1] > gain[0] + 1


def test_where_nothing_was_corrected_nothing_is_expected(nodes: Odometry) -> None:
    i = np.arange(0, LAP, 4)
    asked = measured(i, i + LAP, np.zeros((len(i), 3)))
    odds, gain = expected(build_graph(nodes, NO_CLOSURES), asked, PARAMETERS)
    assert np.isneginf(odds).all()
    assert not gain.any()
