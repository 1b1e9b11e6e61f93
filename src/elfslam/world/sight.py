"""What is seen from one place: the blocks in each direction, and whether they hide a point.

Many points are looked at from one phone. Its surroundings are cut into sectors once, and a line of
sight asks only for the blocks of its own sector.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.world.kernels import kernel
from elfslam.world.plan import (
    GRAZE_M,
    PERSON_HEIGHT_M,
    meets_wall,
    passes_by,
    through_block,
    through_person,
)

SECTORS = 64


class Sight(NamedTuple):
    """A place (3) and the blocks of every sector about it."""

    place: F64
    filled: I64
    block: I64


def make_sight(blocks: int) -> Sight:
    """Room for the sight among `blocks` blocks."""
    shape = SECTORS, max(blocks, 1)
    return Sight(np.zeros(3), np.zeros(SECTORS, dtype=np.int64), np.zeros(shape, dtype=np.int64))


@kernel
def _direction(x, y):
    """A number from 0 to 4 that grows with the angle of (x, y) and needs no arc tangent."""
    size = abs(x) + abs(y)
    if size < 1e-12:
        return 0.0
    if y >= 0.0:
        return y / size if x >= 0.0 else 1.0 - x / size
    return 2.0 - y / size if x < 0.0 else 3.0 + x / size


@kernel
def look(scene, sight, x, y, z, farthest):
    """Fills `sight` with what stands about (x, y, z) up to a distance in plan."""
    sight.place[0], sight.place[1], sight.place[2] = x, y, z
    for sector in range(SECTORS):
        sight.filled[sector] = 0
    for k in range(scene.block_low.shape[0]):
        dx, dy = scene.block_centre[k, 0] - x, scene.block_centre[k, 1] - y
        distance = np.sqrt(dx * dx + dy * dy)
        if distance - scene.block_radius[k] > farthest:
            continue
        first, last = 0, SECTORS - 1
        if distance > scene.block_radius[k]:
            middle, least, most = _direction(dx, dy), 0.0, 0.0
            for c in range(4):
                corner = scene.block_corner[k, c]
                turn = _direction(corner[0] - x, corner[1] - y) - middle
                turn -= 4.0 * np.round(turn / 4.0)
                least, most = min(least, turn), max(most, turn)
            first = int(np.floor((middle + least) * (SECTORS / 4) - 1e-6))
            last = int(np.floor((middle + most) * (SECTORS / 4) + 1e-6))
        for sector in range(first, last + 1):
            at = sector % SECTORS
            sight.block[at, sight.filled[at]] = k
            sight.filled[at] += 1


@kernel
def hides(scene, people, sight, x, y, z):
    """Whether a wall, a block or a person stands between the place of `sight` and (x, y, z)."""
    ax, ay, az = sight.place[0], sight.place[1], sight.place[2]
    if meets_wall(scene, ax, ay, x, y, -1, -1):
        return True
    dx, dy, dz = x - ax, y - ay, z - az
    length = np.sqrt(dx * dx + dy * dy)
    for p in range(people.shape[0]):
        enter, leave = through_person(people[p, 0], people[p, 1], ax, ay, dx, dy)
        if leave > enter and min(az + enter * dz, az + leave * dz) < PERSON_HEIGHT_M:
            return True
    sector = int(_direction(dx, dy) * (SECTORS / 4)) % SECTORS
    for at in range(sight.filled[sector]):
        k = sight.block[sector, at]
        low, high = scene.block_low[k], scene.block_high[k]
        if high <= min(az, z) or low >= max(az, z) or passes_by(scene, k, ax, ay, dx, dy, length):
            continue
        enter, leave = through_block(scene.block_corner[k], ax, ay, dx, dy)
        if (leave - enter) * length > GRAZE_M:
            first, then = az + enter * dz, az + leave * dz
            if min(first, then) < high and max(first, then) > low:
                return True
    return False
