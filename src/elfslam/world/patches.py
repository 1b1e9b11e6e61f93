"""A room's surface as plane faces, cut into patches that scatter, and what a ray of sound meets."""

import zlib
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.grid import in_ring
from elfslam.world.kernels import kernel
from elfslam.world.materials import Material, absorption_fall, mirror_fall, scattering_rise
from elfslam.world.room import Block, Room

PATCH_M = 0.8
"""Side of a patch at most."""
TRIES = 4
"""Points tried in each patch: the share of them in the open is the share of it that counts."""
OPEN_M = 0.01
"""A point is in the open where the air this far before it is in the room and in no block."""
BLOCK_FACES = 6

Frame = tuple[F64, F64, F64, F64, tuple[float, float], Material]
"""Of a face: its corner, two directions along its sides, its normal, its size and its material."""


class Faces(NamedTuple):
    """Plane faces (f): the walls, the floor, the ceiling, then six for each block.

    `corner`, `along`, `up` and `normal` (f, 3) are in the room, the air lies on the normal's side;
    `size` and `cells` (f, 2) are along both sides. Cell (i, j) of face f is the patch
    `cell_patch[first_cell[f] + i * cells[f, 1] + j]`, or none (-1). Of the energy a face keeps
    `kept`, and of that it scatters `scattered`; `mirror_fall` is the power of the frequency with
    which the mirrored pressure falls.
    """

    corner: F64
    along: F64
    up: F64
    normal: F64
    size: F64
    cells: I64
    first_cell: I64
    cell_patch: I64
    kept: F64
    scattered: F64
    mirror_fall: F64


class Patches(NamedTuple):
    """Patches (p): the point in the open that scatters for it, its frame, area (m2), face, which of
    all cells it is, the share of what it keeps that it scatters, and the powers of the frequency
    with which the pressures fall that it mirrors and scatters."""

    point: F64
    normal: F64
    along: F64
    up: F64
    area: F64
    face: I64
    cell: I64
    scattered: F64
    mirror_fall: F64
    diffuse_fall: F64


class Boxes(NamedTuple):
    """Blocks (b) for rays: centre and half size in plan, cosine and sine, underside and top."""

    centre: F64
    half: F64
    turn: F64
    low: F64
    high: F64


def faces_and_patches(room: Room) -> tuple[Faces, Patches]:
    """Every face in cells of at most `PATCH_M`, and a patch in each cell not wholly covered."""
    frames = _room_frames(room) + [frame for block in room.blocks for frame in _block_frames(block)]
    corner, along, up, normal, size = (
        np.array([frame[k] for frame in frames], dtype=np.float64) for k in range(5)
    )
    cells = np.maximum(np.ceil(size / PATCH_M - 1e-9), 1).astype(np.int64)
    counts = cells.prod(axis=1)
    face = np.repeat(np.arange(len(frames)), counts)
    first = np.cumsum(counts) - counts
    share = draws_by_owner(room, 1, counts, (TRIES, 2))
    tried = _points_in_cells(corner, along, up, size, cells, face, first, share)
    free = _in_the_open(room, tried, normal[face])
    kept = np.flatnonzero(free.any(axis=1))
    cell_patch = np.full(len(face), -1, dtype=np.int64)
    cell_patch[kept] = np.arange(len(kept))
    area = free.mean(axis=1) * (size.prod(axis=1) / counts)[face]
    surfaces = [frame[5] for frame in frames]
    faces = Faces(
        corner, along, up, normal, size, cells, first, cell_patch,
        np.array([1 - surface.absorption for surface in surfaces]),
        np.array([surface.scattering for surface in surfaces]),
        np.array([surface.mirror_fall for surface in surfaces]),
    )  # fmt: skip
    on = face[kept]
    point = tried[kept, free[kept].argmax(axis=1)]
    scattered = uneven(faces.scattered[on], draws_by_owner(room, 4, counts, ())[kept])
    absorbed = absorption_fall(1 - faces.kept[on])
    return faces, Patches(
        point, normal[on], along[on], up[on], area[kept], on, kept, scattered,
        absorbed + mirror_fall(scattered), absorbed - scattering_rise(scattered),
    )  # fmt: skip


def uneven(share: F64, draw: F64) -> F64:
    """Shares of this mean from uniform draws: most patches scatter little, a few nearly all."""
    return np.asarray(draw ** (1 / np.maximum(share, 1e-6) - 1))


def draws_by_owner(room: Room, purpose: int, counts: I64, shape: tuple[int, ...]) -> F64:
    """Uniform draws (sum of counts, *shape) for the cells of all faces, `counts` (f) in each.

    Every wall and every block has its own, wherever it and others stand.
    """
    flat = len(room.walls) + 2
    owners = [f"wall {k}" for k in range(len(room.walls))] + ["floor", "ceiling"]
    owners += [block.name for block in room.blocks]
    cells = np.append(counts[:flat], counts[flat:].reshape(-1, BLOCK_FACES).sum(axis=1))
    seeds = ([room.seed, zlib.crc32(owner.encode()), purpose] for owner in owners)
    parts = [
        np.random.default_rng(seed).uniform(size=(count, *shape))
        for seed, count in zip(seeds, cells, strict=True)
    ]
    return np.concatenate(parts)


def boxes_of(room: Room) -> Boxes:
    """The room's blocks."""
    turn = np.array([block.turn_rad for block in room.blocks])
    return Boxes(
        np.array([block.centre_m for block in room.blocks]).reshape(-1, 2),
        np.array([block.size_m[:2] / 2 for block in room.blocks]).reshape(-1, 2),
        np.column_stack([np.cos(turn), np.sin(turn)]).reshape(-1, 2),
        np.array([block.base_m for block in room.blocks], dtype=np.float64),
        np.array([block.top_m for block in room.blocks], dtype=np.float64),
    )


def _room_frames(room: Room) -> list[Frame]:
    up, height = np.array([0.0, 0.0, 1.0]), room.height_m
    frames: list[Frame] = []
    following = np.roll(room.outline_m, -1, axis=0)
    for a, b, surface in zip(room.outline_m, following, room.walls, strict=True):
        length = float(np.linalg.norm(b - a))
        along = np.append((b - a) / length, 0.0)
        inward = np.array([-along[1], along[0], 0.0])
        frames.append((np.append(a, 0.0), along, up, inward, (length, height), surface))
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    low, high = np.append(room.corner_m, 0.0), np.append(room.corner_m, height)
    size = float(room.size_m[0]), float(room.size_m[1])
    return [*frames, (low, x, y, up, size, room.floor), (high, x, y, -up, size, room.ceiling)]


def _block_frames(block: Block) -> list[Frame]:
    cos, sin = np.cos(block.turn_rad), np.sin(block.turn_rad)
    x, y, z = np.array([cos, sin, 0.0]), np.array([-sin, cos, 0.0]), np.array([0.0, 0.0, 1.0])
    length, width, height = (float(side) for side in block.size_m)
    low = np.append(block.centre_m, block.base_m) - x * length / 2 - y * width / 2
    surface = block.surface
    return [
        (low, y, z, -x, (width, height), surface),
        (low + length * x, y, z, x, (width, height), surface),
        (low, x, z, -y, (length, height), surface),
        (low + width * y, x, z, y, (length, height), surface),
        (low, x, y, -z, (length, width), surface),
        (low + height * z, x, y, z, (length, width), surface),
    ]


def _points_in_cells(
    corner: F64, along: F64, up: F64, size: F64, cells: I64, face: I64, first: I64, share: F64
) -> F64:
    """Points of every cell (c, t, 3) at shares (c, t, 2) of its sides."""
    at = np.arange(len(face)) - first[face]
    cell = np.column_stack([at // cells[face, 1], at % cells[face, 1]])
    metres = (cell[:, None] + share) * (size / cells)[face][:, None]
    return np.asarray(
        corner[face][:, None]
        + metres[..., :1] * along[face][:, None]
        + metres[..., 1:] * up[face][:, None]
    )


def _in_the_open(room: Room, points: F64, normal: F64) -> Bool:
    """Whether the air before each point (c, t, 3) is in the room and in no block."""
    before = (points + OPEN_M * normal[:, None]).reshape(-1, 3)
    free = in_ring(room.outline_m, before[:, :2]) & (before[:, 2] > 0)
    free &= before[:, 2] < room.height_m
    for block in room.blocks:
        local = block.turn_back(before[:, :2] - block.centre_m)
        beside = (np.abs(local) > block.size_m[:2] / 2).any(axis=1)
        free &= beside | (before[:, 2] < block.base_m) | (before[:, 2] > block.top_m)
    return np.asarray(free.reshape(points.shape[:2]))


@kernel
def _enter(boxes, k, x, y, z, dx, dy, dz, farthest):
    """Where a ray enters box k and by which of its faces; -1 where it does not in time."""
    c, s = boxes.turn[k, 0], boxes.turn[k, 1]
    px, py = x - boxes.centre[k, 0], y - boxes.centre[k, 1]
    place = (c * px + s * py, c * py - s * px, z)
    way = (c * dx + s * dy, c * dy - s * dx, dz)
    ends = (
        -boxes.half[k, 0], boxes.half[k, 0], -boxes.half[k, 1], boxes.half[k, 1],
        boxes.low[k], boxes.high[k],
    )  # fmt: skip
    enter, leave, side = 1e-6, farthest, -1
    for axis in range(3):
        if abs(way[axis]) < 1e-12:
            if place[axis] < ends[2 * axis] or place[axis] > ends[2 * axis + 1]:
                return 0.0, -1
            continue
        first = 0 if way[axis] > 0.0 else 1
        near = (ends[2 * axis + first] - place[axis]) / way[axis]
        if near > enter:
            enter, side = near, 2 * axis + first
        leave = min(leave, (ends[2 * axis + 1 - first] - place[axis]) / way[axis])
    return (enter, side) if enter < leave else (0.0, -1)


@kernel
def first_face(faces, boxes, walls, x, y, z, dx, dy, dz):
    """The first face that a ray meets and how far away it is; -1 where it meets none."""
    height = faces.corner[walls + 1, 2]
    nearest, found = 1e9, -1
    if dz < 0.0:
        nearest, found = -z / dz, walls
    elif dz > 0.0:
        nearest, found = (height - z) / dz, walls + 1
    for f in range(walls):
        nx, ny = faces.normal[f, 0], faces.normal[f, 1]
        towards = nx * dx + ny * dy
        if towards >= 0.0:
            continue
        px, py = x - faces.corner[f, 0], y - faces.corner[f, 1]
        at = -(nx * px + ny * py) / towards
        share = (px + at * dx) * faces.along[f, 0] + (py + at * dy) * faces.along[f, 1]
        if 1e-9 < at < nearest and 0.0 <= share <= faces.size[f, 0]:
            nearest, found = at, f
    for k in range(boxes.low.shape[0]):
        at, side = _enter(boxes, k, x, y, z, dx, dy, dz, nearest)
        if side >= 0:
            nearest, found = at, walls + 2 + BLOCK_FACES * k + side
    return found, nearest


@kernel
def patch_at(faces, f, x, y, z):
    """The patch of face f that lies about a point on it; -1 where the face is covered there."""
    x, y, z = x - faces.corner[f, 0], y - faces.corner[f, 1], z - faces.corner[f, 2]
    u = x * faces.along[f, 0] + y * faces.along[f, 1] + z * faces.along[f, 2]
    v = x * faces.up[f, 0] + y * faces.up[f, 1] + z * faces.up[f, 2]
    i = min(max(int(u / faces.size[f, 0] * faces.cells[f, 0]), 0), faces.cells[f, 0] - 1)
    j = min(max(int(v / faces.size[f, 1] * faces.cells[f, 1]), 0), faces.cells[f, 1] - 1)
    return faces.cell_patch[faces.first_cell[f] + i * faces.cells[f, 1] + j]
