"""Marginal covariances against GTSAM and chance; variance components and verdicts as planted."""

import dataclasses

import gtsam
import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.geometry import between, chain, compose
from elfslam.base.values import Closures, Odometry, PoseGraph, Verdict
from elfslam.stages.graph import GraphParameters, build_graph, judge, optimise, uncertainty
from elfslam.stages.graph.blocks import pattern_of
from elfslam.stages.graph.building import edges_of
from elfslam.stages.graph.solving import as_gtsam, as_values, solve
from elfslam.stages.graph.uncertainty import covariance_of, residuals, with_own_noise

ANCHOR = 1e-3

LAPS, LAP = 8, 40
TRUE_SIGMA = np.array([0.05, 0.03, 0.01])
CLOSURE_SIGMA = np.array([0.1, 0.1, 0.1])
PARAMETERS = GraphParameters(noise_prior=0.0, least_step_noise=0.01)


def walked(seed: int, stated: F64, *, closing: bool = True) -> tuple[PoseGraph, F64]:
    """Laps of a circle with independent errors, said to be `stated`, and the truth."""
    generator = np.random.default_rng(seed)
    moves = np.tile([0.7, 0.0, 2 * np.pi / LAP], (LAPS * LAP, 1))
    truth = chain(np.zeros(3), moves)
    odometry = chain(np.zeros(3), moves + generator.normal(0, TRUE_SIGMA, moves.shape))
    nodes = Odometry(0.5 * np.arange(len(truth)), odometry, np.tile(stated, (len(moves), 1)))
    i = np.arange(LAP // 2, len(truth) - LAP, 2) if closing else np.zeros(0, dtype=np.int64)
    errors = generator.normal(0, CLOSURE_SIGMA, (len(i), 3))
    relative = compose(between(truth[i], truth[i + LAP]), errors)
    covariance = np.tile(np.diag(CLOSURE_SIGMA**2), (len(i), 1, 1))
    closures = Closures(i, i + LAP, np.full(len(i), 0.6), relative, covariance)
    return build_graph(nodes, closures), truth


def told(graph: PoseGraph, parameters: GraphParameters = PARAMETERS) -> F64:
    """The sigmas (3) of steps that the loops tell."""
    poses = solve(graph, graph.initial, parameters)
    _, weighed = with_own_noise(graph, poses, parameters)
    steps = edges_of(weighed, ~weighed.is_closure)
    return 1 / np.sqrt(np.diagonal(steps.information[5]))


@pytest.mark.parametrize("wrong_by", [0.5, 1.0, 3.0])
def test_planted_noise_is_found_whatever_was_stated(wrong_by: float) -> None:
    found = np.mean([told(walked(seed, wrong_by * TRUE_SIGMA)[0]) for seed in range(6)], axis=0)
    npt.assert_allclose(found, TRUE_SIGMA, rtol=0.3)


def test_factors_are_one_where_the_statement_is_right() -> None:
    def factors(seed: int) -> F64:
        graph, _ = walked(seed, TRUE_SIGMA)
        return uncertainty.variance_factors(
            graph, solve(graph, graph.initial, PARAMETERS), PARAMETERS
        )

    mean = np.mean([factors(seed) for seed in range(10)], axis=0)
    npt.assert_allclose(mean, 1.0, atol=0.2)


def test_steps_stated_too_noisy_get_narrower_sigmas_and_no_more_say() -> None:
    graph, _ = walked(0, 4 * TRUE_SIGMA)
    start = solve(graph, graph.initial, PARAMETERS)
    poses, told_graph = with_own_noise(graph, start, PARAMETERS)
    npt.assert_allclose(poses, start, atol=1e-3)
    surer = np.diagonal(told_graph.information[5]) / np.diagonal(graph.information[5])
    assert (surer > 5).all()
    stated = dataclasses.replace(PARAMETERS, noise_rounds=0)
    t_s = np.arange(len(graph.initial), dtype=np.float64)
    narrow, wide = optimise(graph, t_s, PARAMETERS), optimise(graph, t_s, stated)
    ratio = narrow.covariance[1:, 0, 0] / wide.covariance[1:, 0, 0]
    assert np.median(ratio) < 0.4


def test_the_map_of_steps_stated_too_exact_gets_better() -> None:
    stated = dataclasses.replace(PARAMETERS, noise_rounds=0)
    errors: dict[GraphParameters, list[float]] = {PARAMETERS: [], stated: []}
    for seed in range(6):
        graph, truth = walked(seed, 0.1 * TRUE_SIGMA)
        for parameters, found in errors.items():
            made = optimise(graph, 0.5 * np.arange(len(truth)), parameters)
            apart = made.world_from_body[:, :2] - truth[:, :2]
            found.append(float(np.hypot(*apart.T).mean()))
    assert all(own < other for own, other in zip(errors[PARAMETERS], errors[stated], strict=True))


def test_the_prior_speaks_for_what_was_stated_and_the_floor_holds() -> None:
    graph, _ = walked(0, 4 * TRUE_SIGMA)
    sure = dataclasses.replace(PARAMETERS, noise_prior=1e6)
    npt.assert_allclose(told(graph, sure), 4 * TRUE_SIGMA, rtol=0.01)
    held = dataclasses.replace(PARAMETERS, least_step_noise=0.5)
    npt.assert_allclose(told(graph, held), 2 * TRUE_SIGMA, rtol=1e-6)


def test_a_step_that_is_less_sure_than_the_others_keeps_what_it_has_beyond() -> None:
    graph, _ = walked(0, TRUE_SIGMA)
    information = graph.information.copy()
    information[0, 2, 2] = 1 / 0.3**2
    doubtful = dataclasses.replace(graph, information=information)
    poses = solve(doubtful, doubtful.initial, PARAMETERS)
    _, weighed = with_own_noise(doubtful, poses, PARAMETERS)
    assert 1 / np.sqrt(weighed.information[0, 2, 2]) == pytest.approx(0.3, rel=0.01)


def set_off(
    aside: float, differing: float, heading_sigma: float = 0.1, prior: float = 0.0
) -> float:
    """Sigma told of the first heading, by what headings of closures differ; `aside` was stated."""
    graph, _ = walked(0, TRUE_SIGMA)
    measurements, information = graph.measurements.copy(), graph.information.copy()
    closing = np.flatnonzero(graph.is_closure)
    generator = np.random.default_rng(1)
    measurements[closing, 2] = generator.normal(0, differing, len(closing))
    information[0, 2, 2] = 1 / (TRUE_SIGMA[2] ** 2 + aside**2)
    information[closing, 2, 2] = heading_sigma**-2
    graph = dataclasses.replace(graph, measurements=measurements, information=information)
    parameters = dataclasses.replace(PARAMETERS, noise_prior=prior)
    poses = solve(graph, graph.initial, parameters)
    _, weighed = with_own_noise(graph, poses, parameters)
    return float(weighed.information[0, 2, 2] ** -0.5)


def test_headings_that_differ_between_visits_tell_how_far_the_first_may_point_aside() -> None:
    assert set_off(0.1, 0.3) == pytest.approx(0.3, rel=0.2)
    assert set_off(0.1, 0.02) == pytest.approx(0.1, rel=0.05)
    assert set_off(0.1, 0.3, prior=1e5) == pytest.approx(0.1, rel=0.05)


def test_what_tells_no_heading_or_sets_off_as_it_goes_on_keeps_its_start() -> None:
    assert set_off(0.1, 0.3, heading_sigma=2.0) == pytest.approx(0.1, rel=0.05)
    assert set_off(0.0, 0.3) < 0.05


def test_closures_and_graphs_without_any_stay_as_they_are() -> None:
    graph, _ = walked(0, 2 * TRUE_SIGMA)
    _, weighed = with_own_noise(graph, solve(graph, graph.initial, PARAMETERS), PARAMETERS)
    kept = graph.information[graph.is_closure]
    npt.assert_array_equal(weighed.information[weighed.is_closure], kept)
    alone, _ = walked(0, TRUE_SIGMA, closing=False)
    poses, same = with_own_noise(alone, alone.initial, PARAMETERS)
    assert same is alone
    npt.assert_array_equal(poses, alone.initial)


def loop(generator: np.random.Generator) -> PoseGraph:
    """Ten poses round a loop and two closures, all measured with noise."""
    truth = chain(np.array([1.0, 2.0, 0.3]), np.tile([1.0, 0.1, 0.6], (9, 1)))
    edges = np.array([*((k, k + 1) for k in range(9)), (9, 0), (7, 2)])
    root = generator.normal(size=(len(edges), 3, 3))
    information = 400 * np.eye(3) + 20 * root @ root.swapaxes(1, 2)
    noise = np.linalg.cholesky(np.linalg.inv(information)) @ generator.normal(size=(11, 3, 1))
    measured = compose(between(truth[edges[:, 0]], truth[edges[:, 1]]), noise[:, :, 0])
    return PoseGraph(truth, edges, measured, information, np.arange(11) >= 9)


def test_residuals_and_covariances_are_gtsams() -> None:
    graph = loop(np.random.default_rng(3))
    problem, values = as_gtsam(graph, ANCHOR), as_values(graph.initial)
    ours = residuals(graph.initial, graph.edges, graph.measurements)
    for k in range(len(graph.edges)):
        npt.assert_allclose(ours[k], problem.at(k).unwhitenedError(values), atol=1e-12)
    assert uncertainty.half_square(graph, graph.initial) == pytest.approx(problem.error(values))
    pairs = np.array([[1, 6], [8, 3]])
    pattern = pattern_of(np.vstack([graph.edges, pairs]), 10)
    poses, equations = uncertainty.settle(graph, graph.initial, pattern, ANCHOR, 20)
    known = uncertainty.marginal_covariances(equations)
    theirs = gtsam.Marginals(problem, as_values(poses))
    for i, j in pairs:
        joint = theirs.jointMarginalCovariance([int(i), int(j)])
        for a, b in ((i, i), (i, j), (j, i)):
            covariance = covariance_of(known, np.array([a]), np.array([b]))[0]
            npt.assert_allclose(covariance, joint.at(int(a), int(b)), rtol=1e-4, atol=1e-8)


def test_covariances_are_what_chance_makes_of_the_poses() -> None:
    pairs, draws = np.array([[2, 6]]), 600
    pattern = pattern_of(np.vstack([measured_again(0).edges, pairs]), 10)
    ends, between_them = [], []
    for seed in range(draws):
        graph = measured_again(seed)
        poses, equations = uncertainty.settle(graph, graph.initial, pattern, ANCHOR, 5)
        ends.append(between(graph.initial[6], poses[6]))
        wanted = between(graph.initial[[2]], graph.initial[[6]])
        between_them.append(residuals(poses, pairs, wanted))
    known = uncertainty.marginal_covariances(equations)
    own = covariance_of(known, np.array([6]), np.array([6]))[0]
    wanted = between(graph.initial[[2]], graph.initial[[6]])
    relative = uncertainty.predicted_covariance(known, graph.initial, pairs, wanted)
    for wanted, drawn in ((own, np.array(ends)), (relative[0], np.array(between_them)[:, 0])):
        scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
        npt.assert_allclose(np.cov(drawn.T) / scale, wanted / scale, atol=0.15)


def measured_again(seed: int) -> PoseGraph:
    """The loop, its poses the true ones, with noise as its information states it."""
    graph, root = loop(np.random.default_rng(0)), np.array([20.0, 30.0, 50.0])
    noise = np.random.default_rng([4, seed]).normal(size=(11, 3)) / root
    true = between(graph.initial[graph.edges[:, 0]], graph.initial[graph.edges[:, 1]])
    stated = np.tile(np.diag(root**2), (11, 1, 1))
    return PoseGraph(graph.initial, graph.edges, compose(true, noise), stated, graph.is_closure)


def test_the_verdict_counts_who_agrees() -> None:
    graph, _ = walked(0, TRUE_SIGMA)
    closing = np.flatnonzero(graph.is_closure)
    wrong, measured = closing[::8], graph.measurements.copy()
    measured[wrong] = compose(measured[wrong], np.array([6.0, 0.0, 0.0]))
    attacked = dataclasses.replace(graph, measurements=measured)
    stated = dataclasses.replace(PARAMETERS, noise_rounds=0)
    solved = optimise(attacked, np.arange(len(graph.initial)), stated)
    verdict, true = solved.verdict, len(closing) - len(wrong)
    assert verdict.believed + verdict.rejected == len(closing)
    assert verdict.believed >= 0.95 * true
    assert verdict.believed_agreeing / verdict.believed > 0.97
    assert verdict.rejected_agreeing <= 2
    everything = np.ones(len(closing), dtype=np.bool_)
    all_believed = judge(attacked, solved.world_from_body, everything, stated)
    assert all_believed.believed == len(closing)
    assert all_believed.believed_agreeing <= true


def test_a_walk_without_closures_has_no_verdict() -> None:
    graph, _ = walked(0, TRUE_SIGMA, closing=False)
    assert optimise(graph, np.arange(len(graph.initial)), PARAMETERS).verdict is None


def test_a_verdict_says_itself_in_a_line() -> None:
    assert str(Verdict(9, 8, 3, 0, 0.99)).startswith("8 of 9 believed closures and 0 of 3 rej")


BIAS_RADPS = 0.03


def turned_steadily(seed: int) -> tuple[PoseGraph, F64]:
    """The laps, by a heading that drifts all along as a gyroscope's bias makes it, said so."""
    graph, truth = walked(seed, TRUE_SIGMA)
    drift_turn_rad = np.where(graph.is_closure, 0.0, 0.5 * BIAS_RADPS)
    moves = graph.measurements + [0.0, 0.0, 1.0] * drift_turn_rad[:, None]
    initial = chain(truth[0], moves[~graph.is_closure])
    return dataclasses.replace(
        graph, initial=initial, measurements=moves, drift_turn_rad=drift_turn_rad
    ), truth


def test_a_steady_drift_is_found_and_the_map_is_straight() -> None:
    graph, truth = turned_steadily(3)
    without = dataclasses.replace(graph, drift_turn_rad=None)
    found, bent = (solve(each, each.initial, PARAMETERS) for each in (graph, without))
    assert uncertainty.steady_drift(graph, found) == pytest.approx(-1.0, abs=0.05)
    off_m = [np.abs(poses[:, :2] - truth[:, :2]).max() for poses in (found, bent)]
    assert off_m[0] < 1.0 < off_m[1]


def test_the_drift_widens_covariances_as_a_state_of_its_own_does() -> None:
    graph, _ = turned_steadily(4)
    poses = solve(graph, graph.initial, PARAMETERS)
    pattern = pattern_of(graph.edges, len(poses))
    equations = uncertainty.equations_at(graph, poses, pattern, ANCHOR)
    known = uncertainty.marginal_covariances(equations)
    straight = uncertainty.without_drift(graph, uncertainty.steady_drift(graph, poses))
    residual, near, far = uncertainty.jacobians(poses, graph.edges, straight.measurements)
    size = 3 * len(poses)
    rows = np.zeros((len(graph.edges), 3, size + 1))
    for edge, (i, j) in enumerate(graph.edges):
        rows[edge, :, 3 * i : 3 * i + 3], rows[edge, :, 3 * j : 3 * j + 3] = near[edge], far[edge]
    step = 1e-6
    more = uncertainty.without_drift(straight, step)
    rows[:, :, -1] = (residuals(poses, graph.edges, more.measurements) - residual) / step
    normal = np.einsum("eax,eab,eby->xy", rows, graph.information, rows)
    normal[range(3), range(3)] += ANCHOR**-2
    normal[-1, -1] += 1.0
    dense = np.linalg.inv(normal)[:size, :size].reshape(len(poses), 3, len(poses), 3)
    i, j = graph.edges.T
    npt.assert_allclose(covariance_of(known, i, j), dense[i, :, j, :], rtol=1e-3, atol=1e-8)
