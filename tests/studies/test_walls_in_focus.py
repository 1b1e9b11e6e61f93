"""Planted walls come into focus where they stand, and pairs of frames tell how they near."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.values import DISCARDED_SAMPLES, ECHO_RATE_HZ, ECHO_SAMPLES, Echoes, Odometry
from elfslam.line.acoustic_odometry import AcousticOdometryParameters
from elfslam.line.chirp import ChirpParameters, make_chirp
from studies.simulated_walk import SimulatedWalk
from studies.walls_in_focus import RATIOS, SHOWN_SEEDS, _first_of_each, picture, range_changes

CHIRP = make_chirp(ChirpParameters(), ECHO_RATE_HZ)
PARAMETERS = AcousticOdometryParameters()
FRAMES = 130
SPEED_MPS = 0.7
WALL_M = 12.0


def walk_towards_a_wall() -> tuple[Echoes, Odometry]:
    """Straight along y, towards a wall at WALL_M; noise elsewhere."""
    t_s = np.arange(FRAMES) / 10.0
    delay_s = 2 * (WALL_M - SPEED_MPS * (t_s + PARAMETERS.ahead_s)) / PARAMETERS.sound_mps
    samples = 0.02 * np.random.default_rng(4).standard_normal((FRAMES, ECHO_SAMPLES))
    for row, first in zip(samples, np.rint(delay_s * ECHO_RATE_HZ).astype(int), strict=True):
        start = int(first) - DISCARDED_SAMPLES
        if 0 <= start <= ECHO_SAMPLES - 441:
            row[start : start + 441] += CHIRP.samples
    at_s = np.arange(0.0, FRAMES / 10.0 + 1.0, 0.5)
    poses = np.column_stack([np.zeros(len(at_s)), SPEED_MPS * at_s, np.full(len(at_s), np.pi / 2)])
    echoes = Echoes(t_s, samples.astype(np.float32), np.zeros((0, 2)))
    return echoes, Odometry(at_s, poses, np.ones((len(at_s) - 1, 3)))


def test_a_wall_is_seen_where_it_is_and_brightest_at_the_true_scale() -> None:
    echoes, nodes = walk_towards_a_wall()
    made = picture(echoes, nodes, CHIRP, 1.0, 1)
    direction, distance = np.unravel_index(int(made.strength.argmax()), made.strength.shape)
    assert made.direction_rad[direction] == pytest.approx(np.pi / 2, abs=0.2)
    middle_m = WALL_M - SPEED_MPS * (np.mean(echoes.t_s[60:120]) + PARAMETERS.ahead_s)
    assert made.distance_m[distance] == pytest.approx(middle_m, abs=0.05)
    short = picture(echoes, nodes, CHIRP, 0.85, 1)
    assert short.strength.max() < 0.8 * made.strength.max()


def test_a_wall_ahead_comes_nearer_by_the_whole_move() -> None:
    echoes, nodes = walk_towards_a_wall()
    alike = range_changes(echoes, nodes, CHIRP, 1.0)
    assert RATIOS[alike.argmax()] == pytest.approx(-1.0, abs=0.05)
    assert RATIOS[range_changes(echoes, nodes, CHIRP, 1.25).argmax()] == pytest.approx(
        -0.8, abs=0.05
    )


def test_a_few_walks_of_each_world_are_shown() -> None:
    walks = [SimulatedWalk(world, seed, 5) for world in ("studio", "mall") for seed in range(9)]
    shown = _first_of_each(walks)
    assert [walk.world for walk in shown] == ["studio"] * SHOWN_SEEDS + ["mall"] * SHOWN_SEEDS
    assert [walk.seed for walk in shown[:SHOWN_SEEDS]] == list(range(SHOWN_SEEDS))
