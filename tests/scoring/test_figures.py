"""Traces hold what they should; reductions keep what matters."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Closures, Run, Similarity
from elfslam.scoring import charts, figures


def test_an_ellipse_has_the_axes_of_its_covariance() -> None:
    covariance = np.array([[[4.0, 0], [0, 1.0]]])
    trace = figures.ellipse_trace(np.array([[10.0, 5.0]]), covariance, figures.SLAM)
    x, y = np.asarray(trace.x), np.asarray(trace.y)
    assert np.nanmax(x) == pytest.approx(12, abs=0.02)
    assert np.nanmin(y) == pytest.approx(4, abs=0.02)


@pytest.mark.parametrize("lean", [1.2, -1.2])
def test_an_ellipse_lies_one_sigma_away_all_round(lean: float) -> None:
    covariance = np.array([[4.0, lean], [lean, 1.0]])
    trace = figures.ellipse_trace(np.zeros((1, 2)), covariance[None], figures.SLAM)
    ring = np.column_stack([trace.x, trace.y]).astype(float)[:-1]
    squared = np.einsum("ni,ij,nj->n", ring, np.linalg.inv(covariance), ring)
    assert np.allclose(squared, 1, atol=0.01)


def test_closures_are_grouped_by_weight() -> None:
    xy_m = np.array([[0, 0], [1, 0], [2, 0], [3, 0.0]])
    closures = Closures([0, 1], [2, 3], [1, 1], np.zeros((2, 3)), np.zeros((2, 3, 3)))
    traces = figures.closure_traces(xy_m, closures, np.array([0.0, 1.0]))
    names = ["closures, rejected (1)", "closures, trusted (1)"]
    assert [trace.name for trace in traces] == names
    assert np.asarray(traces[0].x)[:2].tolist() == [0, 2]


def test_judged_closures_are_coloured_and_leave_out_the_unknown() -> None:
    xy_m = np.array([[0, 0], [1, 0], [2, 0], [3, 0.0]])
    zeros, i, j = np.zeros((4, 3)), [0, 1, 2, 0], [2, 3, 3, 3]
    closures = Closures(i, j, [1, 1, 1, 1], zeros, np.zeros((4, 3, 3)))
    right, known = np.array([True, False, False, False]), np.array([True, True, False, True])
    kept = np.array([True, True, True, False])
    traces = figures.judged_closure_traces(xy_m, closures, right, known, kept)
    names = [f"closures, {word} (1)" for word in ("rejected", "right", "wrong")]
    assert [trace.name for trace in traces] == names


def test_thinned_keeps_the_ends_and_the_few() -> None:
    assert figures.thinned(5, 40).tolist() == [0, 1, 2, 3, 4]
    assert figures.thinned(1000, 3).tolist() == [0, 499, 999]
    assert figures.thinned(0, 3).tolist() == []


@pytest.mark.parametrize("by_m", [[0.0, 0.0], [5e5, 5e6]], ids=["here", "UTM"])
def test_a_walk_is_drawn_to_the_millimetre_wherever_it_lies(by_m: list[float]) -> None:
    walk = np.array([[0.0, 0.0], [0.123, 0.456], [3.0, 0.0], [7.891, 5.25]]) + by_m
    path, *_ = figures.walk_traces(walk, name="walk", color="black")
    np.testing.assert_allclose(np.column_stack([path.x, path.y]), walk, rtol=0, atol=6e-4)


def test_a_flat_outline_is_refused() -> None:
    with pytest.raises(InputError, match="outline"):
        figures.FloorPlan(outline=np.zeros(4))


def test_reduction_keeps_the_greatest_score() -> None:
    size = 2 * charts.MATRIX_AT_MOST + 1
    scores = np.zeros((size, size), np.float32)
    scores[1234, 77] = 0.9
    small, starts = charts.reduced(Similarity(scores, "elf"))
    assert max(small.shape) <= charts.MATRIX_AT_MOST
    row, column = np.unravel_index(np.argmax(small), small.shape)
    assert starts[row] <= 1234 < starts[row + 1]
    assert starts[column] <= 77 < starts[column + 1]
    assert small[row, column] == pytest.approx(0.9)


def test_the_histogram_counts_each_pair_once() -> None:
    scores = np.eye(20, dtype=np.float32)
    scores[2, 5] = scores[5, 2] = 0.7
    figure = charts.histogram_figure(Similarity(scores, "elf"), 0.4)
    assert np.sum(figure.data[0].y) == 20 * 19 / 2
    assert figure.layout.shapes[0].x0 == 0.4


def test_many_losses_are_one_list_of_shapes(run: Run) -> None:
    starts_s = np.arange(600.0)
    assert run.echoes is not None
    echoes = replace(run.echoes, losses_s=np.column_stack([starts_s, np.full(600, 0.2)]))
    shapes = charts.steps_figure(run.odometry, echoes).layout.shapes
    assert [shape.x0 for shape in shapes] == starts_s.tolist()
    assert shapes[7].x1 == pytest.approx(7.2)
    assert not charts.steps_figure(run.odometry, None).layout.shapes


def test_a_lifted_walk_keeps_its_rounds_apart() -> None:
    corners = np.array([[0, 0], [4, 0], [4, 2], [0, 2.0]])
    raised = figures.lifted(np.vstack([corners, corners]), np.arange(8.0))
    moved = raised[4:] - raised[:4]
    assert moved[:, 0] == pytest.approx(0)
    assert moved[:, 1] == pytest.approx(figures.LIFT * 4.0 * 4 / 7)
    assert np.isfinite(figures.lifted(np.zeros((3, 2)), np.arange(3.0))).all()


def test_the_error_share_ends_at_the_greatest_error(run: Run) -> None:
    errors = np.array([0.5, 2.0, 1.0])
    figure = charts.error_share_figure({("SLAM", "aligned"): (np.arange(3.0), errors)})
    assert (figure.data[0].x[-1], figure.data[0].y[-1]) == (2.0, 1.0)
    assert figure.data[0].line.color == figures.SLAM


def test_a_loss_is_drawn_step_by_step_and_by_blocks() -> None:
    losses = np.array([4.0, 2.0, 3.0, 1.0])
    figure = charts.loss_figure(losses, np.array([2, 4]), np.array([3.0, 2.0]))
    each, mean = figure.data
    assert (list(each.x), list(each.y)) == ([1, 2, 3, 4], [4, 2, 3, 1])
    assert (list(mean.x), list(mean.y)) == ([2, 4], [3, 2])
