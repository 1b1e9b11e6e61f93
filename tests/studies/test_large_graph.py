"""The planted city: its edges are what they claim, and the back end finds its streets again."""

import numpy as np

from elfslam.base.geometry import between
from elfslam.stages.graph.uncertainty import residuals
from studies.benchmarks.large_graph import APART, SIGMA, City, city, error_m, solved, solved_by
from studies.pose_graphs import PLAIN_LM


def _small(false_share: float, seed: int = 0) -> City:
    return city(600, 600, false_share, np.random.default_rng(seed))


def test_true_closures_say_the_truth_up_to_their_noise_and_false_ones_do_not() -> None:
    each = _small(0.5)
    closures = each.graph.is_closure
    edges, told = each.graph.edges[closures], each.graph.measurements[closures]
    whitened = residuals(each.world_from_body, edges, told) / SIGMA
    right = np.sum(whitened**2, axis=1)
    assert abs(right[: each.true_closures].mean() - 3) < 0.5
    assert np.median(right[each.true_closures :]) > 1000
    assert (edges[:, 1] - edges[:, 0] > APART).all()
    assert closures.sum() == 2 * each.true_closures


def test_the_walk_goes_along_streets_a_metre_at_a_time() -> None:
    moves = between(*(_small(0.0).world_from_body[k] for k in (slice(None, -1), slice(1, None))))
    assert np.allclose(np.linalg.norm(moves[:, :2], axis=1), 1.0)
    assert set(np.round(moves[:, 2] / (np.pi / 2)).astype(int)) <= {-1, 0, 1, 2, -2}


def test_false_closures_cost_the_back_end_nothing_and_plain_least_squares_the_map() -> None:
    each = _small(0.3)
    ours, plain = solved(each), solved_by(each, (PLAIN_LM,))
    assert ours["false kept"] == 0
    assert float(str(ours["error (m)"])) < 0.5
    assert float(str(plain[f"{PLAIN_LM} (m)"])) > 5
    assert error_m(each, each.world_from_body) == 0
