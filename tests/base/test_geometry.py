"""Planar poses are a group; quaternions agree with scipy."""

import numpy as np
import numpy.testing as npt
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from elfslam.base import geometry
from elfslam.base.arrays import F64
from elfslam.base.geometry import between, chain, compose, inverse, wrap_angle

metres = st.floats(-100, 100)
angles = st.floats(-20, 20)
poses = st.tuples(metres, metres, angles).map(np.array)
IDENTITY = np.zeros(3)


def assert_same_pose(got: F64, wanted: F64) -> None:
    """Equal positions, and headings equal up to whole turns."""
    npt.assert_allclose(got[..., :2], wanted[..., :2], atol=1e-9)
    npt.assert_allclose(wrap_angle(got[..., 2] - wanted[..., 2]), 0, atol=1e-9)


def matrix(pose: F64) -> F64:
    """Homogeneous matrix of a pose."""
    x, y, heading = pose
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1]])


@given(angles)
def test_a_wrapped_angle_points_the_same_way_within_half_a_turn(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert abs(wrapped) <= np.pi
    npt.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angle), atol=1e-12)


def test_half_a_turn_wraps_to_minus_half_a_turn() -> None:
    angles = np.array([np.pi, -np.pi, 3 * np.pi / 2])
    npt.assert_allclose(wrap_angle(angles), [-np.pi, -np.pi, -np.pi / 2])


def test_a_step_ahead_goes_where_the_body_faces() -> None:
    there = compose(np.array([1.0, 2.0, np.pi / 2]), np.array([3.0, 1.0, 0.5]))
    npt.assert_allclose(there, [0.0, 5.0, np.pi / 2 + 0.5], atol=1e-12)


@given(poses, poses)
def test_composing_poses_is_multiplying_their_matrices(a: F64, b: F64) -> None:
    npt.assert_allclose(matrix(compose(a, b)), matrix(a) @ matrix(b), atol=1e-9)


@given(poses)
def test_inverse_and_identity(a: F64) -> None:
    assert_same_pose(compose(a, inverse(a)), IDENTITY)
    assert_same_pose(compose(inverse(a), a), IDENTITY)
    assert_same_pose(compose(a, IDENTITY), a)
    assert_same_pose(compose(IDENTITY, a), a)


@given(poses, poses, poses)
def test_composition_is_associative(a: F64, b: F64, c: F64) -> None:
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)))


@given(poses, poses)
def test_between_leads_from_one_pose_to_the_other(a: F64, b: F64) -> None:
    assert_same_pose(compose(a, between(a, b)), b)


@given(poses, poses, poses)
def test_between_does_not_see_where_the_world_lies(world: F64, a: F64, b: F64) -> None:
    assert_same_pose(between(compose(world, a), compose(world, b)), between(a, b))


def test_rows_are_composed_one_by_one_and_a_single_pose_with_all() -> None:
    rows = np.random.default_rng(0).normal(size=(5, 3))
    moved = compose(rows[0], rows)
    npt.assert_allclose(moved, [compose(rows[0], row) for row in rows])
    npt.assert_allclose(inverse(rows), [inverse(row) for row in rows])


@given(poses, st.lists(poses, max_size=8))
def test_a_chain_is_repeated_composition(start: F64, moves: list[F64]) -> None:
    wanted = [start]
    for move in moves:
        wanted.append(compose(wanted[-1], move))
    assert_same_pose(chain(start, np.array(moves).reshape(-1, 3)), np.array(wanted))


def test_chain_undoes_between() -> None:
    walk = np.cumsum(np.random.default_rng(1).normal(size=(50, 3)), axis=0)
    assert_same_pose(chain(walk[0], between(walk[:-1], walk[1:])), walk)


def test_headings_are_interpolated_along_the_shorter_arc() -> None:
    turn = np.array([[0.0, 0.0, 3.0], [2.0, 4.0, -3.0]])
    halfway = geometry.interpolate_poses(np.array([0.0, 1]), turn, np.array([0, 0.25, 0.5, 1]))
    arc = 2 * np.pi - 6
    npt.assert_allclose(halfway[:, :2], [[0, 0], [0.5, 1], [1, 2], [2, 4]])
    npt.assert_allclose(halfway[:, 2], wrap_angle(3 + arc * np.array([0, 0.25, 0.5, 1])))


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_quaternions_turn_as_scipy_turns_them(components: list[float]) -> None:
    quaternion = np.array(components) / np.linalg.norm(components)
    ours = geometry.rotation_from_quaternion(quaternion)
    npt.assert_allclose(ours, Rotation.from_quat(quaternion).as_matrix(), atol=1e-12)


def test_many_quaternions_at_once() -> None:
    rotations = Rotation.random(7, rng=np.random.default_rng(2))
    ours = geometry.rotation_from_quaternion(rotations.as_quat())
    npt.assert_allclose(ours, rotations.as_matrix(), atol=1e-12)


def test_path_length() -> None:
    assert geometry.path_length_m(np.array([[0, 0], [3, 4], [3, 5.0]])) == 6
