"""A walk as the line hears it, and its true scale."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.values import Odometry, Truth
from studies.heard_walk import hear_walk, true_scale
from studies.simulated_walk import SimulatedWalk


def test_the_true_scale_is_true_over_claimed_length() -> None:
    t_s = np.linspace(0.0, 10.0, 101)
    true = np.column_stack([1.2 * t_s, np.zeros(101), np.zeros(101)])
    nodes = Odometry(t_s[10:91:5], true[10:91:5] / [1.1, 1.0, 1.0] + 3.0, np.ones((16, 3)))
    assert true_scale(nodes, Truth(t_s, true)) == pytest.approx(1.1)


def test_nodes_echoes_and_truth_are_of_one_walk() -> None:
    heard = hear_walk(SimulatedWalk("studio", 100, 1))
    assert heard.chirp.rate_hz == 44_100
    assert heard.truth.t_s[0] <= heard.nodes.t_s[0] < heard.nodes.t_s[-1] <= heard.truth.t_s[-1]
    assert heard.echoes.t_s[-1] == pytest.approx(heard.truth.t_s[-1], abs=0.5)
    assert 0.85 < true_scale(heard.nodes, heard.truth) < 1.15
