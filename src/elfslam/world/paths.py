"""Paths of sound in plan: image sources of walls and block faces, followed beam by beam (kernels).

Between a floor and a flat ceiling the image method splits: reflections at upright faces are found
in plan, and each of their paths is then repeated for the images in height (`acoustics.py`). A beam
is followed only through the part of its mirror that the sound can reach, so every path that comes
out has its reflections on the faces (Borish, J. Acoust. Soc. Am. 75, 1984; beams after Funkhouser
et al., ibid. 115, 2004). Whether something stands in its way is noted for each leg.
"""

from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.world.kernels import kernel
from elfslam.world.plan import (
    MOST_CROSSINGS,
    Crossings,
    Sight,
    make_crossings,
    make_sight,
    meets_wall,
    note_crossings,
)

MOST_PATHS = 4096
MOST_REFLECTIONS = 24
MOST_BOUNCES = 128
"""At floor or ceiling, each."""


class Reach(NamedTuple):
    """How far paths are followed.

    `order` counts all reflections; `plan_order` those at upright faces; at most `block_order` of
    them are block faces, and a path with one has at most `beside_block` reflections in plan.
    """

    longest_m: float = 21.0
    order: int = 12
    plan_order: int = 8
    block_order: int = 1
    beside_block: int = 2


class PlanPaths(NamedTuple):
    """Paths in plan, one row each, and scratch space for finding them.

    `fall` is the power of the frequency with which the gain falls about 17.5 kHz. `departure` and
    `arrival` are unit vectors from the two ends along the path. The crossings of
    path p are `crossing_end[p - 1]` to `crossing_end[p]`; `hit_block` and `hit_at` say which
    block's face reflects how far from the start (-1 in `hit_block`: a wall).
    """

    length: F64
    gain: F64
    fall: F64
    order: I64
    departure: F64
    arrival: F64
    crossing_end: I64
    hit_block: I64
    hit_at: F64
    crossings: Crossings
    image: F64
    share: F64
    face: I64
    following: I64
    on_blocks: I64
    floor_power: F64
    ceiling_power: F64
    from_speaker: Sight
    from_microphone: Sight


def make_plan_paths(blocks: int) -> PlanPaths:
    """Room for the paths between one pair of points."""
    deep = MOST_REFLECTIONS + 1
    length, gain, fall = np.zeros((3, MOST_PATHS))
    return PlanPaths(
        length, gain, fall, np.zeros(MOST_PATHS, dtype=np.int64),
        np.zeros((MOST_PATHS, 2)), np.zeros((MOST_PATHS, 2)),
        np.zeros(MOST_PATHS, dtype=np.int64), np.zeros((MOST_PATHS, deep), dtype=np.int64),
        np.zeros((MOST_PATHS, deep)), make_crossings(blocks), np.zeros((deep, 2)),
        np.zeros((deep, 2)), np.zeros(deep, dtype=np.int64), np.zeros(deep, dtype=np.int64),
        np.zeros(deep, dtype=np.int64), np.zeros(MOST_BOUNCES), np.zeros(MOST_BOUNCES),
        make_sight(blocks), make_sight(blocks),
    )  # fmt: skip


@kernel
def _narrow(low, high, at_a, at_b):
    """Share of a segment on which a linear function, given at its ends, is positive."""
    if at_a < 0.0 and at_b < 0.0:
        return 1.0, 0.0
    if at_a < 0.0:
        low = max(low, at_a / (at_a - at_b))
    elif at_b < 0.0:
        high = min(high, at_a / (at_a - at_b))
    return low, high


@kernel
def _lit_share(scene, paths, depth, f):
    """The part of face f that the beam of the image at `depth` reaches, as shares of its length."""
    low, high = 0.0, 1.0
    if depth == 0:
        return low, high
    mirror = paths.face[depth]
    ix, iy = paths.image[depth, 0], paths.image[depth, 1]
    mx, my = scene.face_a[mirror, 0], scene.face_a[mirror, 1]
    ex, ey = scene.face_b[mirror, 0] - mx, scene.face_b[mirror, 1] - my
    ax, ay = mx + paths.share[depth, 0] * ex - ix, my + paths.share[depth, 0] * ey - iy
    bx, by = mx + paths.share[depth, 1] * ex - ix, my + paths.share[depth, 1] * ey - iy
    turn = 1.0 if ax * by - ay * bx > 0.0 else -1.0
    px, py = scene.face_a[f, 0] - ix, scene.face_a[f, 1] - iy
    qx, qy = scene.face_b[f, 0] - ix, scene.face_b[f, 1] - iy
    low, high = _narrow(low, high, turn * (ax * py - ay * px), turn * (ax * qy - ay * qx))
    low, high = _narrow(low, high, turn * (px * by - py * bx), turn * (qx * by - qy * bx))
    nx, ny = scene.face_normal[mirror, 0], scene.face_normal[mirror, 1]
    front_p = nx * (px + ix - mx) + ny * (py + iy - my)
    front_q = nx * (qx + ix - mx) + ny * (qy + iy - my)
    return _narrow(low, high, front_p, front_q)


@kernel
def _distance(scene, f, low, high, x, y):
    """Least distance of a point from the part of face f between two shares of its length."""
    ax, ay = scene.face_a[f, 0], scene.face_a[f, 1]
    ex, ey = scene.face_b[f, 0] - ax, scene.face_b[f, 1] - ay
    share = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
    share = min(max(share, low), high)
    dx, dy = x - ax - share * ex, y - ay - share * ey
    return np.sqrt(dx * dx + dy * dy)


@kernel
def _child(scene, paths, depth, f, reach):
    """Pushes the image of the image at `depth` in face f; whether there is one."""
    x, y = paths.image[depth, 0], paths.image[depth, 1]
    nx, ny = scene.face_normal[f, 0], scene.face_normal[f, 1]
    ahead = nx * (x - scene.face_a[f, 0]) + ny * (y - scene.face_a[f, 1])
    if ahead <= 1e-9 or ahead > reach.longest_m:
        return False
    low, high = _lit_share(scene, paths, depth, f)
    if high - low <= 1e-12 or _distance(scene, f, low, high, x, y) > reach.longest_m:
        return False
    paths.face[depth + 1] = f
    paths.image[depth + 1, 0] = x - 2.0 * ahead * nx
    paths.image[depth + 1, 1] = y - 2.0 * ahead * ny
    paths.share[depth + 1, 0], paths.share[depth + 1, 1] = low, high
    paths.on_blocks[depth + 1] = paths.on_blocks[depth] + (scene.face_block[f] >= 0)
    paths.following[depth + 1] = 0
    return True


@kernel
def _hit(scene, paths, depth, x, y):
    """Where the line from (x, y) to the image at `depth` meets its mirror: x, y, share or -1."""
    f = paths.face[depth]
    ix, iy = paths.image[depth, 0], paths.image[depth, 1]
    nx, ny = scene.face_normal[f, 0], scene.face_normal[f, 1]
    ax, ay = scene.face_a[f, 0], scene.face_a[f, 1]
    here = nx * (x - ax) + ny * (y - ay)
    there = nx * (ix - ax) + ny * (iy - ay)
    if here <= 0.0 or there >= 0.0:
        return 0.0, 0.0, -1.0
    part = here / (here - there)
    hx, hy = x + part * (ix - x), y + part * (iy - y)
    ex, ey = scene.face_b[f, 0] - ax, scene.face_b[f, 1] - ay
    return hx, hy, ((hx - ax) * ex + (hy - ay) * ey) / (ex * ex + ey * ey)


@kernel
def _trace(scene, people, paths, depth, count, noted, source, target, reach):
    """Follows one image back from the target; crossings noted so far, or -1 where it is no path."""
    x, y = target[0], target[1]
    dx, dy = paths.image[depth, 0] - x, paths.image[depth, 1] - y
    length = np.sqrt(dx * dx + dy * dy)
    if length > reach.longest_m:
        return -1
    left, gain, fall, onto = length, 1.0, 0.0, -1
    for level in range(depth, -1, -1):
        hx, hy, f = source[0], source[1], -1
        if level > 0:
            hx, hy, share = _hit(scene, paths, level, x, y)
            if share < paths.share[level, 0] or share > paths.share[level, 1]:
                return -1
            f = paths.face[level]
            gain *= scene.face_gain[f]
            fall += scene.face_fall[f]
        leg = np.sqrt((hx - x) ** 2 + (hy - y) ** 2)
        if meets_wall(scene, hx, hy, x, y, f, onto):
            return -1
        left -= leg
        noted = note_crossings(scene, people, paths.crossings, noted, left, hx, hy, x, y)
        if level > 0:
            paths.hit_block[count, level - 1] = scene.face_block[f]
            paths.hit_at[count, level - 1] = left
        if level == depth:
            paths.arrival[count, 0], paths.arrival[count, 1] = dx, dy
        if level == 0:
            paths.departure[count, 0], paths.departure[count, 1] = x - hx, y - hy
        x, y, onto = hx, hy, f
    dx, dy = paths.departure[count, 0], paths.departure[count, 1]
    size = np.sqrt(dx * dx + dy * dy)
    for k in range(2):
        paths.arrival[count, k] /= max(length, 1e-12)
        paths.departure[count, k] /= max(size, 1e-12)
    paths.length[count], paths.gain[count], paths.order[count] = length, gain, depth
    paths.fall[count] = fall
    return noted


@kernel
def _blocked_at_all_heights(scene, paths, first, last):
    for c in range(first, last):
        if paths.crossings.low[c] <= 0.0 and paths.crossings.high[c] >= scene.height:
            return True
    return False


@kernel
def _last_face(scene, paths, depth, reach):
    """How many faces may follow the image at `depth`: all, the walls alone, or none."""
    touched = paths.on_blocks[depth] > 0
    if depth >= reach.plan_order or (touched and depth >= reach.beside_block):
        return 0
    more = paths.on_blocks[depth] < reach.block_order and depth < reach.beside_block
    return scene.face_gain.shape[0] if more else scene.outer


@kernel
def find_paths(scene, people, paths, source, target, reach):
    """Fills `paths` with all paths in plan from source to target (2); their number.

    Returns -1 where there is no room for them.
    """
    paths.image[0, 0], paths.image[0, 1] = source[0], source[1]
    paths.following[0] = 0
    paths.on_blocks[0] = 0
    depth, count, noted, fresh = 0, 0, 0, True
    while depth >= 0:
        if fresh:
            if count >= MOST_PATHS or noted >= MOST_CROSSINGS - 1:
                return -1
            now = _trace(scene, people, paths, depth, count, noted, source, target, reach)
            if now >= 0 and not _blocked_at_all_heights(scene, paths, noted, now):
                paths.crossing_end[count] = now
                count, noted = count + 1, now
        f = paths.following[depth]
        fresh = False
        if f >= _last_face(scene, paths, depth, reach):
            depth -= 1
            continue
        paths.following[depth] = f + 1
        if depth == 0 or f != paths.face[depth]:
            fresh = _child(scene, paths, depth, f, reach)
            depth += fresh
    return count
