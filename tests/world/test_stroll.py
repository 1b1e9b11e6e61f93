"""People on a route: they stray, stop and walk back, within the free floor, as often as told."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from planted_blocks import loaded

from elfslam.base.arrays import F64
from elfslam.base.errors import ParameterError
from elfslam.world import stroll
from elfslam.world.materials import material
from elfslam.world.room import box, shoebox, standing_room
from elfslam.world.simulate import simulate
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion, Walker
from elfslam.world.world_file import load_world

ROUTE_M = np.array([[6.0, 6.0], [24.0, 6.0], [24.0, 18.0], [6.0, 18.0]])
LAP_M = 60.0
HALL = shoebox(np.array([30.0, 24.0, 4.0]), (material("concrete"),) * 6)
PILLAR = box("pillar", np.array([14.0, 6.6, 0.0]), np.array([1.0, 1.0, 4.0]))
WITH_PILLAR = replace(HALL, blocks=(PILLAR,))


def person_of(seed: int = 0, **habits: float) -> Walker:
    person = stroll.random_person(np.random.default_rng(seed), 0.5)
    none = {"stops_per_min": 0.0, "ways_back_per_min": 0.0, "grips_per_min": 0.0}
    return replace(person, **{**none, **habits})


@cache
def way(*, with_pillar: bool) -> stroll.Way:
    return stroll.way_through(WITH_PILLAR if with_pillar else HALL, ROUTE_M)


@cache
def motion_of(
    seed: int = 0, rounds: int = 2, *, with_pillar: bool = False, **habits: float
) -> Motion:
    along, generator = way(with_pillar=with_pillar), np.random.default_rng(seed)
    return stroll.stroll_on(person_of(seed, **habits), along, rounds, generator)


def beside(motion: Motion) -> F64:
    """How far from the straight legs of the route each moment is, corners apart."""
    x, y = motion.position_m[:, :2].T
    lower = (np.abs(x - 15) < 6) & (y < 12)
    return np.asarray(y[lower] - 6.0)


def ground_speed(motion: Motion) -> F64:
    velocity = np.gradient(motion.position_m[:, :2], 1 / KINEMATICS_RATE_HZ, axis=0)
    return np.asarray(np.linalg.norm(velocity, axis=1))


def test_lanes_scatter_as_told() -> None:
    offsets = np.concatenate([beside(motion_of(seed)) for seed in range(8)])
    assert offsets.std() == pytest.approx(0.5, rel=0.25)
    assert abs(offsets.mean()) < 0.25


def test_a_lane_is_kept_for_a_while() -> None:
    x, y = motion_of().position_m[:, :2].T
    lower = np.flatnonzero((np.abs(x - 15) < 6) & (y < 12))
    leg = lower[: np.flatnonzero(np.diff(lower) > 1)[0]]
    assert np.ptp(y[leg]) < 0.8


@pytest.mark.parametrize("seed", range(2))
def test_nobody_walks_through_a_pillar(seed: int) -> None:
    motion = motion_of(seed, with_pillar=True, lane_m=1.5)
    assert WITH_PILLAR.is_free(motion.position_m[::40, :2], 1.2).all()
    assert standing_room(WITH_PILLAR, motion.position_m[::40, :2]).mean() > 0.98
    wide = beside(motion_of(seed, lane_m=1.5))
    assert np.abs(wide).max() > 0.8


def test_stops_take_time_and_no_way() -> None:
    brisk, often = motion_of(), motion_of(stops_per_min=6.0)
    stood = ground_speed(often) < 0.1
    assert stood.mean() > 2 * (ground_speed(brisk) < 0.1).mean()
    assert often.t_s[-1] > brisk.t_s[-1] + 2 * stroll.STOP_S[0]


def test_ways_back_turn_round_and_end_all_the_same() -> None:
    motion = motion_of(ways_back_per_min=3.0, stops_per_min=0.0)
    way_m = ground_speed(motion).sum() / KINEMATICS_RATE_HZ
    assert way_m > 2 * LAP_M + 4
    assert motion.position_m[-1, :2] == pytest.approx(motion.position_m[0, :2], abs=2.5)
    turned = np.abs(np.gradient(motion.heading_rad, 1 / KINEMATICS_RATE_HZ))
    assert turned.max() > 1.5


def test_whoever_walks_looks_where_they_go() -> None:
    """The heading of the truth is that of the way, on ways back too."""
    motion = motion_of(3, ways_back_per_min=3.0)
    velocity = np.gradient(motion.position_m[:, :2], 1 / KINEMATICS_RATE_HZ, axis=0)
    fast = ground_speed(motion) > 0.6
    ahead = np.column_stack([np.cos(motion.heading_rad), np.sin(motion.heading_rad)])
    assert np.median((velocity * ahead).sum(axis=1)[fast] / ground_speed(motion)[fast]) > 0.98
    assert ((velocity * ahead).sum(axis=1)[fast] > 0).mean() > 0.98


def test_whoever_changes_lanes_looks_where_they_go() -> None:
    """Where furniture narrows the way, lanes slant; nobody walks sideways there."""
    even = {"sway_m": 0.0, "wander_m": 0.0, "step_noise": 0.0, "rhythm_noise": 0.0}
    motion = motion_of(5, with_pillar=True, lane_m=1.5, **even)
    velocity = np.gradient(motion.position_m[:, :2], 1 / KINEMATICS_RATE_HZ, axis=0)
    left = np.column_stack([-np.sin(motion.heading_rad), np.cos(motion.heading_rad)])
    sideways = (velocity * left).sum(axis=1)[ground_speed(motion) > 0.6]
    assert np.abs(sideways).max() < 0.1


def test_phones_are_taken_up_anew() -> None:
    still, often = motion_of(), motion_of(grips_per_min=4.0)
    assert np.ptp(often.pitch_rad) > np.ptp(still.pitch_rad) + np.deg2rad(5)


def covered(motion: Motion) -> F64:
    assert motion.covered_db is not None
    return motion.covered_db


def test_some_new_grips_cover_a_port_until_the_next() -> None:
    """A quarter of them, by 6 to 20 dB; the first grip never does."""
    habits = {"grips_per_min": 8.0, "cover_share": 0.25}
    motions = [motion_of(seed, rounds=1, **habits) for seed in range(8)]
    moments = np.concatenate([covered(motion) for motion in motions])
    assert 0.1 < (moments > 3.0).mean() < 0.35
    assert 17 < moments.max() < 20.0
    assert all(covered(motion)[0] == 0 for motion in motions)
    held = np.concatenate([covered(m)[np.abs(np.gradient(covered(m))) < 1e-12] for m in motions])
    steady = held[held > 0.01]
    assert len(steady) > 10_000
    assert np.quantile(steady, 0.02) >= 6.0  # a grip of a moment does not come so far


def test_a_phone_points_aside_and_comes_back() -> None:
    turns = (m.yaw_rad - m.heading_rad for m in map(motion_of, range(8)))
    aside = np.concatenate([np.angle(np.exp(1j * turn)) for turn in turns])
    assert np.rad2deg(aside.std()) == pytest.approx(8.5, abs=2.5)  # 7 degrees, wobble and swing
    assert abs(np.rad2deg(aside.mean())) < 3


def rates(motion: Motion) -> F64:
    """Rates of turn (3, n), rad/s."""
    angles = np.stack([motion.yaw_rad, motion.pitch_rad, motion.roll_rad])
    return np.asarray(np.gradient(angles, 1 / KINEMATICS_RATE_HZ, axis=1))


def test_a_hand_trembles_as_told_when_its_owner_stands_still() -> None:
    """About every axis and at 3 to 6 Hz, as a second of walking has it beside the swing."""
    habits = {"stops_per_min": 6.0, "tremor_rad": 0.0, "aside_rad": 0.0, "wobble_rad": 0.0}
    motion = motion_of(2, unrest_radps=0.12, **habits)
    calm = motion_of(2, unrest_radps=0.0, **habits)
    stood = ground_speed(motion) < 0.02
    assert stood.sum() > 8 * KINEMATICS_RATE_HZ
    assert rates(motion)[:, stood].std(axis=1) == pytest.approx(np.full(3, 0.12), rel=0.15)
    unrest = rates(motion) - rates(calm)
    power = (np.abs(np.fft.rfft(unrest, axis=1)) ** 2).sum(axis=0)
    hz = np.fft.rfftfreq(unrest.shape[1], 1 / KINEMATICS_RATE_HZ)
    assert 3.0 < np.average(hz, weights=power) < 6.0
    assert motion.position_m.tobytes() == calm.position_m.tobytes()
    assert motion.heading_rad.tobytes() == calm.heading_rad.tobytes()


def test_the_quietest_second_of_people_is_that_of_real_walks() -> None:
    """0.118 rad/s in the median of 80 walks, within a quarter; the surveyor's is a tenth of it."""
    world = load_world("studio")
    quietest: dict[str, list[float]] = {"person": [], "surveyor": []}
    for kind, found in quietest.items():
        for seed in range(9 if kind == "person" else 3):
            imu = simulate(world, seed, rounds=2, walker=kind, sound=False)[0].imu
            seconds = (imu.gyro_radps[k : k + 100] for k in range(0, len(imu.t_s) - 100, 50))
            found.append(min(float(rows.std(axis=0).mean()) for rows in seconds))
    assert np.median(quietest["person"]) == pytest.approx(0.118, rel=0.25)
    assert np.median(quietest["surveyor"]) < 0.012


def footfalls(motion: Motion) -> F64:
    """Times of the steps of somebody under way."""
    return np.interp(np.arange(20, motion.steps[-1] - 20), motion.steps, motion.t_s)


def lengths_of(motion: Motion) -> F64:
    way = np.cumsum(ground_speed(motion)) / KINEMATICS_RATE_HZ
    return np.diff(np.interp(footfalls(motion), motion.t_s, way))


def test_steps_err_each_for_itself() -> None:
    """Lengths scatter by two thirds of what is told, whatever the rhythm."""
    even = {"rhythm_noise": 0.0, "sway_m": 0.0, "wander_m": 0.0}
    lengths, intervals = [], []
    for noise in (0.0, 0.15):
        motion = motion_of(step_noise=noise, **even)
        lengths.append(lengths_of(motion))
        intervals.append(np.diff(footfalls(motion)))
    beside = [np.diff(rows).std() / np.sqrt(2) / rows.mean() for rows in lengths]
    assert beside[1] == pytest.approx(2 / 3 * 0.15, abs=0.02)
    assert beside[0] < 0.02
    assert intervals[1].std() == pytest.approx(intervals[0].std(), rel=0.1)


def test_the_rhythm_of_steps_is_as_uneven_as_told() -> None:
    for noise in (0.0, 0.06):
        times = footfalls(motion_of(step_noise=0.0, rhythm_noise=noise))
        uneven = np.diff(np.diff(times)).std() / np.sqrt(2) / np.diff(times).mean()
        assert uneven == pytest.approx(2 / 3 * noise, abs=0.01)


@pytest.mark.parametrize("lane_m", [0.0, 0.8])
def test_whoever_walks_outside_a_bend_takes_more_steps_and_not_longer_ones(lane_m: float) -> None:
    """Round corners, in any lane, steps stay as long as they are on the straight legs."""
    even = {"step_noise": 0.0, "rhythm_noise": 0.0, "sway_m": 0.0, "wander_m": 0.0}
    for seed in range(2):
        motion = motion_of(seed, lane_m=lane_m, **even)
        lengths = lengths_of(motion)
        bending = np.abs(np.diff(np.interp(footfalls(motion), motion.t_s, motion.heading_rad)))
        assert (bending > 0.3).sum() > 5
        corner = lengths[bending > 0.3].mean() / lengths[bending < 0.05].mean()
        assert corner == pytest.approx(1.0, abs=0.12)
        assert lengths.min() > 0.6 * lengths.mean()
        assert lengths.max() < 1.4 * lengths.mean()


@pytest.mark.parametrize(("world", "lane_m"), [("studio", 0.3), ("office", 0.5), ("mall", 0.8)])
def test_the_larger_the_room_the_wider_the_lanes(world: str, lane_m: float) -> None:
    assert stroll.lane_of(loaded(world).room) == lane_m
    assert lane_m in [lane for _, lane in stroll.LANES_M]


def test_people_are_simulated_and_others_refused() -> None:
    world = load_world("studio")
    kinds = ("surveyor", "person")
    surveyor, person = (simulate(world, 5, rounds=2, walker=by, sound=False)[1] for by in kinds)
    assert person.t_s[-1] != surveyor.t_s[-1]
    assert standing_room(world.room, person.world_from_body[::10, :2]).mean() > 0.97
    with pytest.raises(ParameterError, match="walker 'dog': wanted surveyor or person"):
        simulate(world, 5, walker="dog")
