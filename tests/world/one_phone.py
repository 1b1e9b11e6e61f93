"""One phone in a room for the tests of echoes: where it is, what it hears, and what that says."""

import numpy as np
import numpy.typing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ
from elfslam.world.materials import Material
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers, air_at, image_echoes
from elfslam.world.pulses import CARRIER_HZ
from elfslam.world.room import Block, Room, shoebox
from elfslam.world.scene import Scene, scene_of

C128 = npt.NDArray[np.complex128]
AIR = air_at()
DEAD = Material("dead", 1.0, 0.0, "absorbs all")
HARD = Material("hard", 0.19, 0.0, "reflects 0.9 of the pressure")
SIZE_M = np.array([7.0, 5.0, 3.0])
SPEAKER_M, MICROPHONE_M = np.array([2.3, 1.9, 1.2]), np.array([4.1, 3.2, 1.6])
FIRST_ORDER = Reach(order=1, plan_order=1)
HZ = BAND_LOW_HZ + BIN_HZ * np.arange(BAND_BINS)
X, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def ends_at(
    speaker_m: F64 = SPEAKER_M,
    microphone_m: F64 = MICROPHONE_M,
    *,
    axis: F64 = X,
    velocity_mps: F64 | None = None,
    directivity: float = 0.0,
    held: bool = False,
    ahead: tuple[float, float] = (0.0, 0.0),
) -> Transducers:
    """One phone; it looks upward unless told, and so has no holder behind it."""
    still = np.zeros(3) if velocity_mps is None else velocity_mps
    rows = [np.array(row, dtype=float)[None] for row in (speaker_m, microphone_m, axis, axis)]
    turned, lobed = np.array([ahead]), (directivity, directivity)
    return Transducers(*rows, turned, still[None], still[None], *lobed, held)


def heard(
    room: Room | Scene,
    ends: Transducers | None = None,
    people_m: F64 | None = None,
    reach: Reach = FIRST_ORDER,
) -> C128:
    """The envelope (630) of one phone."""
    scene = scene_of(room) if isinstance(room, Room) else room
    people = np.zeros((0, 2)) if people_m is None else np.atleast_2d(people_m)
    rows = image_echoes(scene, ends or ends_at(), people[None], AIR, reach)
    return rows[0].astype(np.complex128)


def dead_room(*blocks: Block) -> Room:
    return shoebox(SIZE_M, (DEAD,) * 6, blocks)


def length_and_gain(response: C128) -> tuple[float, float]:
    """Length in metres and pressure at 1 m, beside air and spreading, of a single path."""
    transfer = np.fft.fftshift(np.fft.fft(response))
    middle = slice(215, 416)
    slope = np.polyfit(HZ[middle], np.unwrap(np.angle(transfer[middle])), 1)[0]
    coarse_m = -slope / (2 * np.pi) * AIR.speed_mps
    wave_m = AIR.speed_mps / CARRIER_HZ
    carrier = transfer[BAND_BINS // 2]
    turn = np.angle(carrier * np.exp(2j * np.pi * coarse_m / wave_m)) / (2 * np.pi)
    length_m = coarse_m - turn * wave_m
    return length_m, abs(carrier) * length_m * np.exp(AIR.attenuation_per_m * length_m)


def assert_one_path(response: C128, length_m: float, gain: float, rel: float = 1e-3) -> None:
    found_m, found = length_and_gain(response)
    assert found_m == pytest.approx(length_m, abs=2e-4)
    assert found == pytest.approx(gain, rel=rel)
