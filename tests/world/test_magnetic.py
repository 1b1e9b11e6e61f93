"""The magnetic field: dipoles, a field without sources in the room, and what a phone reads."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world import magnetic
from elfslam.world.imu import attitude
from elfslam.world.magnetic import MagneticField, Magnetism, PowerLine, field_at, read_magnetometer
from elfslam.world.materials import material
from elfslam.world.room import shoebox
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion, random_walker, walk

ROOM = shoebox(np.array([8.0, 6.0, 2.6]), (material("concrete"),) * 6)
PERFECT = magnetic.MagnetometerGrade("perfect", 50.0, 1e-9, 0.0, 0.0)
NO_EARTH = np.zeros(3)


def one_dipole(*moment_am2: float) -> MagneticField:
    return MagneticField(NO_EARTH, np.zeros((1, 3)), np.array([moment_am2]))


def room_field(seed: int = 0, magnetism: Magnetism | None = None) -> MagneticField:
    return magnetic.magnetic_field(ROOM, magnetism or Magnetism(), np.random.default_rng(seed))


def walking(seed: int = 0) -> Motion:
    generator = np.random.default_rng(seed)
    route_m = np.array([[1.0, 1.0], [7.0, 1.0], [7.0, 5.0], [1.0, 5.0]])
    return walk(random_walker(generator), route_m, 1, generator)


def jacobian(field: MagneticField, position_m: F64, step_m: float = 1e-3) -> F64:
    """Derivatives (3 of the field, 3 along space) by central differences."""
    moves = step_m * np.eye(3)
    ahead, back = field_at(field, position_m + moves), field_at(field, position_m - moves)
    return np.asarray((ahead - back).T / (2 * step_m))


def test_a_dipole_on_its_axis_and_beside_it() -> None:
    """mu0 / 4 pi times 2 m / r^3 along the axis, and -m / r^3 beside it."""
    at = np.array([[0.0, 0.0, 2.0], [2.0, 0.0, 0.0]])
    along, beside = field_at(one_dipole(0.0, 0.0, 80.0), at)
    np.testing.assert_allclose(along, [0, 0, 0.1 * 2 * 80 / 8], atol=1e-12)
    np.testing.assert_allclose(beside, [0, 0, -0.1 * 80 / 8], atol=1e-12)


@pytest.mark.parametrize("position_m", [[4.0, 3.0, 1.2], [1.0, 1.0, 1.0], [7.5, 0.5, 2.0]])
def test_no_divergence_and_no_curl_in_the_room(position_m: list[float]) -> None:
    slopes = jacobian(room_field(), np.array(position_m))
    size = np.abs(slopes).max()
    assert size > 0.1
    assert np.trace(slopes) == pytest.approx(0.0, abs=1e-5 * size)
    np.testing.assert_allclose(slopes, slopes.T, atol=1e-5 * size)


def test_the_earth_alone_points_north_and_down() -> None:
    plain = Magnetism(strength_ut=50.0, inclination_deg=60.0, north_deg=90.0, dipoles_per_m2=0.0)
    field = field_at(room_field(magnetism=plain), np.array([[1.0, 1.0, 1.0], [5.0, 4.0, 2.0]]))
    expected = [0.0, 25.0, -50 * np.sqrt(3) / 2]
    np.testing.assert_allclose(field, [expected, expected], atol=1e-12)


def test_steel_lies_behind_the_surfaces() -> None:
    magnetism = Magnetism(dipoles_per_m2=3.0)
    at = room_field(magnetism=magnetism).dipole_m
    outside = np.maximum(-at, at - ROOM.size_m).max(axis=1)
    area = 2 * (8 * 6 + 8 * 2.6 + 6 * 2.6)
    assert len(at) == round(3.0 * area)
    assert (outside >= magnetism.depth_m / 2).all()
    assert (outside <= magnetism.depth_m).all()
    below = (at[:, 2] < 0).mean()
    assert below == pytest.approx(48 / area, abs=0.08)


def test_the_field_belongs_to_the_place() -> None:
    at = np.array([[4.0, 3.0, 1.2]])
    first, again, other = (field_at(room_field(seed), at) for seed in (1, 1, 2))
    assert (first == again).all()
    assert np.abs(first - other).max() > 0.5


def test_many_positions_are_as_good_as_few() -> None:
    at = np.random.default_rng(0).uniform(0, 2.5, (4500, 3))
    field = room_field()
    np.testing.assert_allclose(  # sums round by the shape and place of the arrays in memory
        field_at(field, at)[[0, 2100, 4499]], field_at(field, at[[0, 2100, 4499]]), rtol=1e-12
    )
    assert field_at(field, at[:0]).shape == (0, 3)


def test_a_phone_reads_the_field_in_its_own_axes() -> None:
    motion, field = walking(), room_field()
    reading = read_magnetometer(motion, field, PERFECT, np.random.default_rng(0))
    at = np.round(reading.t_s * KINEMATICS_RATE_HZ).astype(int)
    turned_back = attitude(motion)[at].apply(reading.field_ut.copy())
    np.testing.assert_allclose(turned_back, field_at(field, motion.position_m[at]), atol=1e-6)
    assert 1 / np.diff(reading.t_s).mean() == pytest.approx(50.0)


def test_the_ak09911_counts_in_steps_of_0_6_ut() -> None:
    reading = read_magnetometer(walking(), room_field(), magnetic.AK09911, np.random.default_rng(0))
    digits = reading.field_ut / 0.6
    np.testing.assert_allclose(digits, np.round(digits), atol=1e-9)
    assert len(np.unique(np.round(digits))) > 20


def test_noise_and_hard_iron_have_their_size() -> None:
    motion, field = walking(), room_field()
    truth = read_magnetometer(motion, field, PERFECT, np.random.default_rng(0)).field_ut
    grade = replace(magnetic.AK09911, resolution_ut=1e-6)
    errors = np.array(
        [
            read_magnetometer(motion, field, grade, np.random.default_rng(seed)).field_ut - truth
            for seed in range(60)
        ]
    )
    assert errors.mean(axis=1).std() == pytest.approx(grade.hard_iron_ut, rel=0.2)
    assert errors.std(axis=1).mean() == pytest.approx(grade.noise_ut, rel=0.05)


QUIET = magnetic.MainsParameters(noise_uv=0.0, load_spread=0.0)


def line(
    from_m: tuple[float, ...], to_m: tuple[float, ...], *current_a: float, name: str = "line"
) -> PowerLine:
    return PowerLine(name, np.array(from_m), np.array(to_m), np.array(current_a or (1.0,)))


def standing(*position_m: float, yaw_rad: float = 0.0, duration_s: float = 30.0) -> Motion:
    t_s = np.arange(round(duration_s * KINEMATICS_RATE_HZ)) / KINEMATICS_RATE_HZ
    same = np.ones_like(t_s)
    yaw = yaw_rad * same
    return Motion(t_s, same[:, None] * np.array(position_m), yaw, 0 * same, 0 * same, yaw, 0 * same)


def heard(
    motion: Motion, lines: list[PowerLine], parameters: magnetic.MainsParameters = QUIET
) -> F64:
    return magnetic.listen_to_mains(
        motion, lines, 5, np.random.default_rng(0), parameters
    ).amplitude


def test_a_finite_wire_is_the_sum_of_its_pieces() -> None:
    """The closed form against Biot and Savart added up numerically."""
    wire = line((0.0, 0.5, 0.2), (3.0, 1.0, 1.5))
    at = np.array([[1.0, 2.0, 1.2], [-2.0, 0.0, 0.0], [4.0, 1.0, 3.0]])
    share = (np.arange(20_000) + 0.5) / 20_000
    way = wire.to_m - wire.from_m
    away = at[:, None, :] - (wire.from_m + share[:, None] * way)
    cube = np.linalg.norm(away, axis=2, keepdims=True) ** 3
    summed = 0.1 * (np.cross(way / 20_000, away) / cube).sum(axis=1)
    np.testing.assert_allclose(magnetic.line_field_ut(wire, at), summed, rtol=1e-6)


def test_touching_the_cable_stays_finite() -> None:
    wire = line((0.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    at = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    assert np.isfinite(magnetic.line_field_ut(wire, at)).all()


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
    emr = magnetic.listen_to_mains(motion, far, 5, np.random.default_rng(0), parameters)
    assert emr.amplitude.mean() == pytest.approx(0.3 * np.sqrt(np.pi / 2), rel=0.05)
    np.testing.assert_allclose(np.diff(emr.t_s), 0.2, atol=1e-9)


def test_loads_differ_from_day_to_day() -> None:
    wire, motion = [line((-5.0, 0.0, 3.0), (5.0, 0.0, 3.0))], standing(0.0, 0.0, 1.0, duration_s=1)
    parameters = replace(QUIET, load_spread=0.1)
    days = [
        magnetic.listen_to_mains(
            motion, wire, 5, np.random.default_rng(seed), parameters
        ).amplitude[0, 0]
        for seed in range(300)
    ]
    assert np.std(np.log(days)) == pytest.approx(0.1, rel=0.15)
