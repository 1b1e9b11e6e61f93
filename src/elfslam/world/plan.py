"""What lies across a straight line in plan, and what is seen from one place (kernels).

Obstacles do not cut a path at once, because it may pass above or below them: what is noted is from
where to where along the path an obstacle stands, and how high it reaches. Many points are looked at
from one phone: its surroundings are cut into sectors once, and a line of sight asks only for the
blocks of its own sector.
"""

from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.world.kernels import kernel

PERSON_RADIUS_M = 0.22
PERSON_HEIGHT_M = 1.70
MOST_CROSSINGS = 4096
GRAZE_M = 1e-6
"""Lines that touch an obstacle over less than this pass it by."""


class Crossings(NamedTuple):
    """Obstacles met by plan paths: distance from the path's start, heights, the top's gain and how
    that falls with the frequency."""

    enter: F64
    leave: F64
    low: F64
    high: F64
    top_gain: F64
    top_fall: F64
    stamp: I64


def make_crossings(blocks: int) -> Crossings:
    """Room for the crossings of one phone's paths among `blocks` blocks."""
    enter, leave, low, high, top_gain, top_fall = np.zeros((6, MOST_CROSSINGS))
    stamp = np.zeros(blocks + 1, dtype=np.int64)
    return Crossings(enter, leave, low, high, top_gain, top_fall, stamp)


@kernel
def through_block(corner, ax, ay, dx, dy):
    """Shares of the line a + s d, 0 <= s <= 1, between which it is inside a convex quadrangle."""
    enter, leave = 0.0, 1.0
    for k in range(4):
        j = (k + 1) % 4
        ex, ey = corner[j, 0] - corner[k, 0], corner[j, 1] - corner[k, 1]
        inside = ex * (ay - corner[k, 1]) - ey * (ax - corner[k, 0])
        change = ex * dy - ey * dx
        if change > 0.0:
            enter = max(enter, -inside / change)
        elif change < 0.0:
            leave = min(leave, -inside / change)
        elif inside < 0.0:
            return 1.0, 0.0
        if enter >= leave:
            return 1.0, 0.0
    return enter, leave


@kernel
def passes_by(scene, k, ax, ay, dx, dy, length):
    """Whether a line misses the circle about a block."""
    x, y = scene.block_centre[k, 0] - ax, scene.block_centre[k, 1] - ay
    reach = scene.block_radius[k] * length
    along = x * dx + y * dy
    return abs(x * dy - y * dx) > reach or along < -reach or along > length * length + reach


@kernel
def through_person(x, y, ax, ay, dx, dy):
    square = dx * dx + dy * dy
    if square < 1e-18:
        return 1.0, 0.0
    middle = ((x - ax) * dx + (y - ay) * dy) / square
    off_x, off_y = ax + middle * dx - x, ay + middle * dy - y
    left = PERSON_RADIUS_M * PERSON_RADIUS_M - off_x * off_x - off_y * off_y
    if left <= 0.0:
        return 1.0, 0.0
    half = np.sqrt(left / square)
    return max(middle - half, 0.0), min(middle + half, 1.0)


@kernel
def _note(crossings, count, start, length, enter, leave, low, high, top_gain, top_fall):
    if (leave - enter) * length <= GRAZE_M or count >= MOST_CROSSINGS:
        return count
    crossings.enter[count] = start + enter * length
    crossings.leave[count] = start + leave * length
    crossings.low[count] = low
    crossings.high[count] = high
    crossings.top_gain[count] = top_gain
    crossings.top_fall[count] = top_fall
    return count + 1


@kernel
def _note_block(scene, crossings, count, start, k, ax, ay, dx, dy, length):
    if passes_by(scene, k, ax, ay, dx, dy, length):
        return count
    enter, leave = through_block(scene.block_corner[k], ax, ay, dx, dy)
    return _note(
        crossings, count, start, length, enter, leave,
        scene.block_low[k], scene.block_high[k], scene.block_top_gain[k], scene.block_top_fall[k],
    )  # fmt: skip


@kernel
def note_crossings(scene, people, crossings, count, start, ax, ay, bx, by):
    """Adds what stands across a line from a to b, `start` metres into its path; the new count."""
    dx, dy = bx - ax, by - ay
    length = np.sqrt(dx * dx + dy * dy)
    for p in range(people.shape[0]):
        enter, leave = through_person(people[p, 0], people[p, 1], ax, ay, dx, dy)
        count = _note(crossings, count, start, length, enter, leave, 0.0, PERSON_HEIGHT_M, 0.0, 0.0)
    if scene.block_low.shape[0] == 0:
        return count
    if scene.grid_shape[0] * scene.grid_shape[1] == 1:
        for k in range(scene.block_low.shape[0]):
            count = _note_block(scene, crossings, count, start, k, ax, ay, dx, dy, length)
        return count
    crossings.stamp[-1] += 1
    line = crossings.stamp[-1]
    x, y = (ax - scene.grid_origin[0]) / scene.cell, (ay - scene.grid_origin[1]) / scene.cell
    cell_x, cell_y = int(np.floor(x)), int(np.floor(y))
    last_x = int(np.floor((bx - scene.grid_origin[0]) / scene.cell))
    last_y = int(np.floor((by - scene.grid_origin[1]) / scene.cell))
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    per_x = scene.cell / abs(dx) if dx != 0.0 else np.inf
    per_y = scene.cell / abs(dy) if dy != 0.0 else np.inf
    next_x = (cell_x + 1 - x if dx > 0 else x - cell_x) * per_x if dx != 0.0 else np.inf
    next_y = (cell_y + 1 - y if dy > 0 else y - cell_y) * per_y if dy != 0.0 else np.inf
    for _ in range(abs(last_x - cell_x) + abs(last_y - cell_y) + 1):
        if 0 <= cell_x < scene.grid_shape[0] and 0 <= cell_y < scene.grid_shape[1]:
            cell = cell_x * scene.grid_shape[1] + cell_y
            for at in range(scene.cell_start[cell], scene.cell_start[cell + 1]):
                k = scene.cell_block[at]
                if crossings.stamp[k] == line:
                    continue
                crossings.stamp[k] = line
                count = _note_block(scene, crossings, count, start, k, ax, ay, dx, dy, length)
        if next_x < next_y:
            cell_x, next_x = cell_x + step_x, next_x + per_x
        else:
            cell_y, next_y = cell_y + step_y, next_y + per_y
    return count


@kernel
def meets_wall(scene, ax, ay, bx, by, from_face, to_face):
    """Whether the line from a to b, which starts and ends on the named faces, meets a wall."""
    if scene.convex:
        return False
    for f in range(scene.outer):
        if f in (from_face, to_face):
            continue
        px, py = scene.face_a[f, 0], scene.face_a[f, 1]
        ex, ey = scene.face_b[f, 0] - px, scene.face_b[f, 1] - py
        start = ex * (ay - py) - ey * (ax - px)
        end = ex * (by - py) - ey * (bx - px)
        if start * end >= 0.0:
            continue
        dx, dy = bx - ax, by - ay
        low = dx * (py - ay) - dy * (px - ax)
        high = dx * (py + ey - ay) - dy * (px + ex - ax)
        if low * high <= 0.0:
            return True
    return False


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
