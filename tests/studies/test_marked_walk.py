"""The walk over markers: every round steps on all of them."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.geometry import wrap_angle
from elfslam.base.values import Echoes, Odometry
from elfslam.world.walkable import fault_of_route
from elfslam.world.world_file import World, load_world
from studies.trace import FOOT_M, MARKERS, ROUTE_M, SPEED_MPS, marker_poses, walk_over_markers


@pytest.fixture(scope="module")
def lab() -> World:
    return load_world("lab")


@pytest.fixture(scope="module")
def walked(lab: World) -> tuple[Odometry, Echoes]:
    return walk_over_markers(lab, 2, np.random.default_rng(0))


def test_the_route_can_be_walked(lab: World) -> None:
    assert fault_of_route(lab.room, ROUTE_M, closed=True) is None


def test_markers_lie_evenly_and_look_ahead() -> None:
    markers = marker_poses()
    assert markers.shape == (MARKERS, 3)
    steps_m = np.linalg.norm(np.diff(markers[:, :2], axis=0), axis=1)
    assert np.median(steps_m) == pytest.approx(0.729, abs=0.001)
    assert steps_m.min() > 0.5, "shorter only where a corner is cut"
    np.testing.assert_allclose(markers[1:12, 2], 0.0, atol=1e-9)


def test_every_round_steps_on_every_marker(walked: tuple[Odometry, Echoes]) -> None:
    nodes, _ = walked
    assert len(nodes.t_s) == 2 * MARKERS + 1
    markers = np.vstack([np.tile(marker_poses(), (2, 1)), marker_poses()[:1]])
    off_m = nodes.world_from_body[:, :2] - markers[:, :2]
    assert 0.8 * FOOT_M < off_m.std() < 1.2 * FOOT_M
    turned = np.degrees(wrap_angle(nodes.world_from_body[:, 2] - markers[:, 2]))
    assert np.abs(turned).max() < 15
    assert np.abs(np.diff(nodes.world_from_body[:, 2])).max() < 1.2, "no jump by a full turn"


def test_ten_echoes_a_second_at_walking_speed(walked: tuple[Odometry, Echoes]) -> None:
    nodes, echoes = walked
    np.testing.assert_allclose(np.diff(echoes.t_s), 0.1)
    per_step = np.histogram(echoes.t_s, nodes.t_s)[0]
    assert set(per_step) <= {4, 5, 6}
    length_m = np.linalg.norm(np.diff(nodes.world_from_body[:, :2], axis=0), axis=1).sum()
    assert length_m / nodes.t_s[-1] == pytest.approx(SPEED_MPS, rel=0.05)
