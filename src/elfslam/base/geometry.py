"""Planar poses and rotations. A pose is (x m, y m, heading rad); arrays broadcast over rows."""

import numpy as np

from elfslam.base.arrays import F64


def wrap_angle(angle_rad: F64 | float) -> F64:
    """The same angle in [-pi, pi)."""
    return np.asarray((np.asarray(angle_rad) + np.pi) % (2 * np.pi) - np.pi)


def compose(a_from_b: F64, b_from_c: F64) -> F64:
    """a_from_c: poses (..., 3) chained."""
    a, b = np.broadcast_arrays(np.asarray(a_from_b, float), np.asarray(b_from_c, float))
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + cos * b[..., 0] - sin * b[..., 1]
    y = a[..., 1] + sin * b[..., 0] + cos * b[..., 1]
    return np.stack([x, y, wrap_angle(a[..., 2] + b[..., 2])], axis=-1)


def inverse(a_from_b: F64) -> F64:
    """b_from_a."""
    a = np.asarray(a_from_b, float)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = -(cos * a[..., 0] + sin * a[..., 1])
    y = sin * a[..., 0] - cos * a[..., 1]
    return np.stack([x, y, wrap_angle(-a[..., 2])], axis=-1)


def between(world_from_a: F64, world_from_b: F64) -> F64:
    """a_from_b, the move that leads from pose a to pose b, alike wherever both lie."""
    a, b = np.broadcast_arrays(np.asarray(world_from_a, float), np.asarray(world_from_b, float))
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    # Differences come first: far from the origin a rotation about it would lose digits.
    east, north, turn = np.moveaxis(b - a, -1, 0)
    return np.stack([cos * east + sin * north, cos * north - sin * east, wrap_angle(turn)], axis=-1)


def shifted(poses: F64, by_m: F64) -> F64:
    """Poses (..., 3) with all positions moved by `by_m` (2)."""
    return np.asarray(poses + np.append(by_m, 0.0))


def chain(start: F64, moves: F64) -> F64:
    """Poses (n+1, 3) reached from `start` by `moves` (n, 3), each seen from the pose before."""
    headings = np.concatenate([[start[2]], start[2] + np.cumsum(moves[:, 2])])
    cos, sin = np.cos(headings[:-1]), np.sin(headings[:-1])
    x = np.cumsum(cos * moves[:, 0] - sin * moves[:, 1])
    y = np.cumsum(sin * moves[:, 0] + cos * moves[:, 1])
    xy = np.vstack([[0.0, 0.0], np.column_stack([x, y])]) + np.asarray(start[:2])
    return np.column_stack([xy, wrap_angle(headings)])


def mean_pose(poses: F64, weight: F64) -> tuple[F64, F64]:
    """Mean (3) and covariance (3, 3) of poses (n, 3) by their weights (sum 1)."""
    first = poses[int(np.argmax(weight))]
    apart = np.column_stack([poses[:, :2] - first[:2], wrap_angle(poses[:, 2] - first[2])])
    shift = weight @ apart
    centred, mean = apart - shift, first + shift
    mean[2] = wrap_angle(mean[2])
    return mean, centred.T @ (centred * weight[:, None])


def path_length_m(xy_m: F64) -> float:
    """Length of the polyline through positions (n, 2)."""
    return float(np.linalg.norm(np.diff(xy_m, axis=0), axis=1).sum())


def interpolate_poses(t_s: F64, poses: F64, at_s: F64) -> F64:
    """Poses (m, 3) at times `at_s`, linear in position and along the shorter arc in heading."""
    columns = [np.interp(at_s, t_s, poses[:, 0]), np.interp(at_s, t_s, poses[:, 1])]
    heading = np.interp(at_s, t_s, np.unwrap(poses[:, 2]))
    return np.column_stack([*columns, wrap_angle(heading)])


def rotation_from_quaternion(quaternion: F64) -> F64:
    """Rotation matrices (..., 3, 3) from unit quaternions x y z w (..., 4)."""
    x, y, z, w = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
