"""Mains hum: straight wires, harmonics and the loop of an earphone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world.magnetic import MainsParameters, PowerLine, line_field_ut, listen_to_mains
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion

QUIET = MainsParameters(noise_uv=0.0, load_spread=0.0)


def line(
    from_m: tuple[float, ...], to_m: tuple[float, ...], *current_a: float, name: str = "line"
) -> PowerLine:
    return PowerLine(name, np.array(from_m), np.array(to_m), np.array(current_a or (1.0,)))


def standing(*position_m: float, yaw_rad: float = 0.0, duration_s: float = 30.0) -> Motion:
    t_s = np.arange(round(duration_s * KINEMATICS_RATE_HZ)) / KINEMATICS_RATE_HZ
    same = np.ones_like(t_s)
    yaw = yaw_rad * same
    return Motion(t_s, same[:, None] * np.array(position_m), yaw, 0 * same, 0 * same, yaw, 0 * same)


def heard(motion: Motion, lines: list[PowerLine], parameters: MainsParameters = QUIET) -> F64:
    return listen_to_mains(motion, lines, 5, np.random.default_rng(0), parameters).amplitude


def test_a_long_wire_falls_with_distance() -> None:
    """mu0 I / 2 pi d: 0.2 uT at 1 m from one ampere, round the wire by the right hand."""
    wire = line((-1e4, 0.0, 0.0), (1e4, 0.0, 0.0))
    at = np.array([[0.0, 1.0, 0.0], [3.0, 2.0, 0.0], [0.0, 0.0, 4.0]])
    expected = [[0, 0, 0.2], [0, 0, 0.1], [0, -0.05, 0]]
    np.testing.assert_allclose(line_field_ut(wire, at), expected, atol=1e-7)


def test_a_finite_wire_is_the_sum_of_its_pieces() -> None:
    """The closed form against Biot and Savart added up numerically."""
    wire = line((0.0, 0.5, 0.2), (3.0, 1.0, 1.5))
    at = np.array([[1.0, 2.0, 1.2], [-2.0, 0.0, 0.0], [4.0, 1.0, 3.0]])
    share = (np.arange(20_000) + 0.5) / 20_000
    way = wire.to_m - wire.from_m
    away = at[:, None, :] - (wire.from_m + share[:, None] * way)
    cube = np.linalg.norm(away, axis=2, keepdims=True) ** 3
    summed = 0.1 * (np.cross(way / 20_000, away) / cube).sum(axis=1)
    np.testing.assert_allclose(line_field_ut(wire, at), summed, rtol=1e-6)


def test_touching_the_cable_stays_finite() -> None:
    wire = line((0.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    at = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    assert np.isfinite(line_field_ut(wire, at)).all()


def test_the_voltage_is_loop_times_angular_frequency_times_field() -> None:
    """A wire above, along the way of walking: its field at the phone points across."""
    wire = line((-1e4, 0.0, 3.0), (1e4, 0.0, 3.0), 2.0, 0.0, 0.5)
    amplitude = heard(standing(0.0, 0.0, 1.0), [wire])[0]
    first = QUIET.loop_m2 * 2 * np.pi * 50 * 0.1 * 2.0
    third = QUIET.loop_m2 * 2 * np.pi * 150 * 0.1 * 0.5
    np.testing.assert_allclose(amplitude, [first, 0.0, third], rtol=1e-5)


@pytest.mark.parametrize(("yaw_rad", "share"), [(0.0, 1.0), (np.pi, 1.0), (np.pi / 3, 0.5)])
def test_only_the_field_across_the_cord_counts(yaw_rad: float, share: float) -> None:
    wire = line((-1e4, 0.0, 3.0), (1e4, 0.0, 3.0))
    ahead = heard(standing(0.0, 0.0, 1.0), [wire])[0, 0]
    turned = heard(standing(0.0, 0.0, 1.0, yaw_rad=yaw_rad), [wire])[0, 0]
    assert turned == pytest.approx(share * ahead, rel=1e-6)


def test_lines_add_up_with_their_phases() -> None:
    """Never more than the sum, never less than the difference; the longest list of harmonics."""
    one = line((-5.0, 0.0, 3.0), (5.0, 0.0, 3.0), 1.0, 0.2)
    other = line((-5.0, 1.0, 3.0), (5.0, 1.0, 3.0), 0.5, name="other")
    motion = standing(0.0, 0.0, 1.0)
    both = heard(motion, [one, other])[0]
    first, second = heard(motion, [one])[0], heard(motion, [other])[0]
    assert both.shape == (2,)
    assert abs(first[0] - second[0]) < both[0] < first[0] + second[0]
    assert both[1] == pytest.approx(first[1])


def test_noise_and_rate() -> None:
    """Far from every line the amplitude is Rayleigh: mean sigma sqrt(pi / 2)."""
    far = [line((0.0, 0.0, 1e5), (1.0, 0.0, 1e5))]
    parameters = replace(QUIET, noise_uv=0.3, rate_hz=5.0)
    motion = standing(0.0, 0.0, 1.0, duration_s=400.0)
    emr = listen_to_mains(motion, far, 5, np.random.default_rng(0), parameters)
    assert emr.amplitude.mean() == pytest.approx(0.3 * np.sqrt(np.pi / 2), rel=0.05)
    np.testing.assert_allclose(np.diff(emr.t_s), 0.2, atol=1e-9)


def test_loads_differ_from_day_to_day() -> None:
    wire, motion = [line((-5.0, 0.0, 3.0), (5.0, 0.0, 3.0))], standing(0.0, 0.0, 1.0, duration_s=1)
    parameters = replace(QUIET, load_spread=0.1)
    days = [
        listen_to_mains(motion, wire, 5, np.random.default_rng(seed), parameters).amplitude[0, 0]
        for seed in range(300)
    ]
    assert np.std(np.log(days)) == pytest.approx(0.1, rel=0.15)
