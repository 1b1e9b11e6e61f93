"""The magnetic walks of Kok and Solin 2024 (arXiv 2409.01091): a handheld iPad at 10 Hz.

What the .mat files hold, and how it was found out:
- `quat` (w first) turns the ARKit camera frame (x right, y up, z towards the user, with the
  iPad in landscape) into a world with z up: the camera's -z points along the direction of
  travel (mean resultant length 0.98, mean angle below 0.1 rad in all three files).
- `m` is in the axes of the device held upright, a quarter turn about z away: of the 24 ways to
  permute the axes only this one gives a field whose vertical part is steady (-42, -43 and
  -51 microtesla on average) with about 14 microtesla of horizontal field.
- `dPos` are ARKit's position increments in that world, jumps of its relocalisation (up to
  0.8 m in library) included, as in the paper.

The truth is the cumulated `dPos`, its heading where the camera looks. The odometry is always
drifted, see `OdometryError`, and the orientation's yaw drifts with it, so that neither gives the
truth away; roll and pitch are kept, as levelling the field needs them.
"""

import math
import struct
import warnings
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.io

from elfslam.base.arrays import F64
from elfslam.base.bounds import MEBIBYTE, most_bytes
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, chain, rotation_from_quaternion, wrap_angle
from elfslam.base.parameters import parameter
from elfslam.base.text_files import read_bytes
from elfslam.base.values import Magnetometer, Odometry, Orientation, Recording, Truth

MAT_START = b"MATLAB 5.0 MAT-file"
"""So begin those of version 5 to 7."""
START_BYTES, TAG = 128, {b"IM": "<II", b"MI": ">II"}
"""Of the header, which ends in two letters that say how numbers are written."""
PACKED = 15
WHOLE_KINDS = (f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))
KINDS = ("double", "single", *WHOLE_KINDS)
NUMBER_BYTES = 8


def read_mat(file: Path, names: Collection[str]) -> dict[str, npt.NDArray[Any]]:
    """The arrays of these names, as far as they are there. Raises InputError."""
    content = read_bytes(file)
    with _refusing(file):
        _check_claims(content, names)
        found = scipy.io.loadmat(BytesIO(content), variable_names=list(names))
    return {name: np.atleast_2d(found[name]) for name in names if name in found}


def names_in_mat(content: bytes, source: Path) -> set[str]:
    """The names of the arrays in the bytes of a file. Raises InputError, naming `source`."""
    with _refusing(source):
        _check_claims(content, ())
        return {name for name, _, _ in scipy.io.whosmat(BytesIO(content))}


@contextmanager
def _refusing(file: Path) -> Iterator[None]:
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    except Exception as cause:  # scipy raises whatever the damaged bytes led to
        raise InputError(
            f"{file}: cannot be read as a .mat file ({cause!s:.120}); copy it again"
        ) from cause


def _check_claims(content: bytes, names: Collection[str]) -> None:
    most = most_bytes(len(content))
    if sum(_unpacked_bytes(content)) > most:
        raise ValueError("it unpacks to more than can be believed")
    for name, shape, kind in scipy.io.whosmat(BytesIO(content)):
        if name in names and (kind not in KINDS or math.prod(shape) * NUMBER_BYTES > most):
            raise ValueError(f"{name} is {kind} of {shape!s:.40}, wanted numbers, and fewer")


def _unpacked_bytes(content: bytes) -> Iterator[int]:
    """How many bytes each packed element holds, in pieces."""
    order = TAG[content[START_BYTES - 2 : START_BYTES]]
    at = START_BYTES
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(order, content, at)
        at += 8
        if kind == PACKED:
            unpacking, left = zlib.decompressobj(), content[at : at + size]
            while left and not unpacking.eof:
                yield len(unpacking.decompress(left, MEBIBYTE))
                left = unpacking.unconsumed_tail
        at += size


LEAD_IN_SAMPLES = {"library": 149}
"""Samples at the start that the paper drops too."""
CAMERA_FROM_DEVICE = np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
"""A quarter turn about z: the device's x is the camera's y."""
MOST_APART_S = 1.0
"""Field and pose of one row are measured at the same moment, within this."""
SLOWEST_S = 1.0
"""Rows come ten times a second; a longer step is another unit or a pause."""
LARGEST = {"m": 5000.0, "quat": 1.01, "dPos": 10.0}
"""Microtesla, 1 and metres a row that no whole file exceeds."""
SHAPES = {"m": 3, "quat": 4, "dPos": 3, "t": 1, "tm": 1}


@dataclass(frozen=True)
class OdometryError:
    """How the odometry is corrupted, fixed before any result was seen.

    Bias and noise are the values of the paper's own program (heading 0.005 rad/s and variance
    1e-4 rad2 a sample, position variance 1e-4 m2 a sample, 10 samples/s); the scale error, which
    the paper leaves out, is that of a pedestrian's step length model after calibration.
    """

    heading_bias_radps: float = parameter(0.005, "rad/s", "constant turn rate error, random sign")
    heading_sigma_rad: float = parameter(0.01, "rad", "random turn per sample of 0.1 s")
    position_sigma_m: float = parameter(0.01, "m", "random move per sample and axis")
    scale_sigma: float = parameter(0.03, "1", "standard deviation of the constant scale error")


def read_magnetic(
    path: Path, generator: np.random.Generator, drift: OdometryError | None = None
) -> tuple[Recording, Truth]:
    """The walk in a .mat file as a recording with drifted odometry, and its truth.

    The odometry has the 10 Hz of the file and starts at the true pose. The same generator state
    gives the same drift. Raises InputError.
    """
    data = _load(path)
    first = min(data["t"][0, 0], data["tm"][0, 0])
    t_s, field_t_s = data["t"][:, 0] - first, data["tm"][:, 0] - first
    world_from_camera = data["quat"][:, [1, 2, 3, 0]]
    poses = _true_poses(data["dPos"], world_from_camera)
    odometry = drifted_odometry(t_s, poses, drift or OdometryError(), generator)
    yaw_error = wrap_angle(odometry.world_from_body[:, 2] - poses[:, 2])
    world_from_phone = _multiply(_multiply(_yaw(yaw_error), world_from_camera), CAMERA_FROM_DEVICE)
    recording = Recording(
        name=path.stem,
        device="iPad",
        odometry=odometry,
        orientation=Orientation(t_s, world_from_phone),
        magnetometer=Magnetometer(field_t_s, data["m"]),
    )
    return recording, Truth(t_s, poses)


def _load(path: Path) -> dict[str, F64]:
    content = read_mat(path, SHAPES)
    data = {name: content.get(name, np.empty((0, 0))) for name in SHAPES}
    rows = len(data["m"])
    for name, columns in SHAPES.items():
        wanted = (rows - 1 if name == "dPos" else rows, columns)
        if data[name].shape != wanted or rows < 2:
            got = data[name].shape
            raise InputError(f"{path}: {name} has shape {got}, wanted {wanted}; check the file")
        if data[name].dtype.kind not in "iuf" or not np.isfinite(data[name]).all():
            raise InputError(f"{path}: {name} holds more than finite numbers; check the file")
        if np.abs(data[name]).max() > LARGEST.get(name, np.inf):
            most = np.abs(data[name]).max()
            raise InputError(
                f"{path}: {name} reaches {most:g}, wanted at most {LARGEST[name]:g}; check the file"
            )
    _check_clocks(path, data["t"][:, 0], data["tm"][:, 0])
    lead_in = LEAD_IN_SAMPLES.get(path.stem, 0)
    if rows < lead_in + 2:
        raise InputError(f"{path}: got {rows} samples, wanted more than {lead_in}; check the file")
    return {name: np.asarray(array[lead_in:], dtype=float) for name, array in data.items()}


def _check_clocks(path: Path, t_s: F64, field_t_s: F64) -> None:
    for name, times_s in (("t", t_s), ("tm", field_t_s)):
        steps_s = np.diff(times_s)
        if steps_s.min() <= 0 or steps_s.max() > SLOWEST_S:
            raise InputError(
                f"{path}: {name} steps by {steps_s.min():g} to {steps_s.max():g} s, wanted more "
                f"than 0 and at most {SLOWEST_S:g}; give increasing seconds"
            )
    apart_s = float(np.abs(field_t_s - t_s).max())
    if apart_s > MOST_APART_S:
        raise InputError(
            f"{path}: tm is up to {apart_s:g} s away from t, wanted at most {MOST_APART_S:g}; "
            "put both on one clock in seconds"
        )


def _true_poses(increments_m: F64, world_from_camera: F64) -> F64:
    xy_m = np.vstack([[0.0, 0.0], np.cumsum(increments_m[:, :2], axis=0)])
    forward = -rotation_from_quaternion(world_from_camera)[:, :2, 2]
    return np.column_stack([xy_m, np.arctan2(forward[:, 1], forward[:, 0])])


def drifted_odometry(
    t_s: F64, poses: F64, drift: OdometryError, generator: np.random.Generator
) -> Odometry:
    """Odometry at times (n) that starts at the first of the true poses (n, 3) and drifts away."""
    moves = between(poses[:-1], poses[1:])
    sign = generator.choice([-1.0, 1.0])
    scale = 1 + drift.scale_sigma * generator.standard_normal()
    noise = generator.standard_normal(moves.shape)
    bias_rad = drift.heading_bias_radps * np.diff(t_s)
    xy_m = scale * moves[:, :2] + drift.position_sigma_m * noise[:, :2]
    turn_rad = moves[:, 2] + sign * bias_rad + drift.heading_sigma_rad * noise[:, 2]
    drifted = chain(poses[0], np.column_stack([xy_m, turn_rad]))
    along_m = np.abs(moves[:, :2]) * drift.scale_sigma
    sigma_xy = np.hypot(drift.position_sigma_m, along_m)
    sigma = np.column_stack([sigma_xy, np.hypot(drift.heading_sigma_rad, bias_rad)])
    return Odometry(t_s, drifted, sigma)


def _yaw(angle_rad: F64) -> F64:
    zero = np.zeros(len(angle_rad))
    return np.column_stack([zero, zero, np.sin(angle_rad / 2), np.cos(angle_rad / 2)])


def _multiply(a_from_b: F64, b_from_c: F64) -> F64:
    """a_from_c: quaternions x y z w (n, 4) chained."""
    a, b = np.broadcast_arrays(a_from_b, b_from_c)
    vector = a[:, 3:] * b[:, :3] + b[:, 3:] * a[:, :3] + np.cross(a[:, :3], b[:, :3])
    w = a[:, 3] * b[:, 3] - (a[:, :3] * b[:, :3]).sum(axis=1)
    return np.column_stack([vector, w])
