"""A room as flat arrays for the kernels: reflecting faces, blocks in a grid, clutter and edges."""

import zlib
from itertools import chain
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.world.materials import Material
from elfslam.world.room import Block, Room

CLUTTER_RADIUS_M = (0.06, 0.27)
TEXTURE_PER_M2 = 0.5
"""Points per square metre of wall, floor and ceiling: they carry the diffuse reflection."""
EDGE_GAIN = 0.025
"""Backscatter of a right-angled rigid edge at 17.5 kHz, in square roots of a metre: the diffraction
coefficient of Keller (J. Opt. Soc. Am. 52, 1962) away from its singular directions."""
CELL_M = 1.0
FEW_BLOCKS = 16
"""Up to so many blocks the grid is one cell: looking at all is quicker than walking through it."""
OUTSIDE_M = 0.005
"""Clutter is lifted this far off its face, so that its own block does not hide it."""


class Scene(NamedTuple):
    """What sound meets. Faces 0 to `outer - 1` are the room's walls, then four per block.

    In plan: `face_a`, `face_b`, `face_normal` (f, 2), `face_gain`, `face_fall`, `face_block` (f);
    `block_corner` (b, 4, 2), `block_centre` (b, 2), `block_radius`, `block_low`, `block_high`,
    `block_top_gain`, `block_top_fall` (b). A fall is the power of the frequency with which a gain
    falls about 17.5 kHz. The grid's cell c lists blocks `cell_block[cell_start[c]:cell_start[c +
    1]]`. `point`, `point_normal` (s, 3) and `point_radius` (s) scatter; `edge_a`, `edge_b`,
    `edge_normal` (e, 3) diffract.
    """

    face_a: F64
    face_b: F64
    face_normal: F64
    face_gain: F64
    face_fall: F64
    face_block: I64
    outer: int
    convex: bool
    height: float
    floor_gain: float
    ceiling_gain: float
    floor_fall: float
    ceiling_fall: float
    block_corner: F64
    block_centre: F64
    block_radius: F64
    block_low: F64
    block_high: F64
    block_top_gain: F64
    block_top_fall: F64
    cell: float
    grid_origin: F64
    grid_shape: I64
    cell_start: I64
    cell_block: I64
    point: F64
    point_normal: F64
    point_radius: F64
    edge_a: F64
    edge_b: F64
    edge_normal: F64


def scene_of(room: Room) -> Scene:
    """The scene of a room; its clutter is the same for the same seed, block by block."""
    corners = np.array([block.corners_m for block in room.blocks]).reshape(-1, 4, 2)
    a = np.vstack([room.outline_m, corners.reshape(-1, 2)])
    b = np.vstack(
        [np.roll(room.outline_m, -1, axis=0), np.roll(corners, -1, axis=1).reshape(-1, 2)]
    )
    outer, count = len(room.outline_m), len(room.blocks)
    along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    normal[outer:] *= -1.0
    gain, fall, top_gain, top_fall = _mirrors(room)
    cell_m, origin, shape, start, listed = _grid(room, corners)
    point, point_normal, radius = _clutter(room)
    edge_a, edge_b, edge_normal = _edges(room)
    return Scene(
        face_a=a,
        face_b=b,
        face_normal=normal,
        face_gain=gain,
        face_fall=fall,
        face_block=np.append(np.full(outer, -1), np.repeat(np.arange(count), 4)),
        outer=outer,
        convex=_is_convex(room.outline_m),
        height=float(room.height_m),
        floor_gain=room.floor.reflection,
        ceiling_gain=room.ceiling.reflection,
        floor_fall=room.floor.mirror_fall,
        ceiling_fall=room.ceiling.mirror_fall,
        block_corner=corners,
        block_centre=corners.mean(axis=1),
        block_radius=np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1) / 2,
        block_low=np.array([block.base_m for block in room.blocks], dtype=np.float64),
        block_high=np.array([block.top_m for block in room.blocks], dtype=np.float64),
        block_top_gain=top_gain,
        block_top_fall=top_fall,
        cell=cell_m,
        grid_origin=origin,
        grid_shape=shape,
        cell_start=start,
        cell_block=listed,
        point=point,
        point_normal=point_normal,
        point_radius=radius,
        edge_a=edge_a,
        edge_b=edge_b,
        edge_normal=edge_normal,
    )


def _mirrors(room: Room) -> tuple[F64, F64, F64, F64]:
    walls = np.array([[side.reflection, side.mirror_fall] for side in room.walls])
    tops = np.array(
        [[block.surface.reflection, block.surface.mirror_fall] for block in room.blocks]
    ).reshape(-1, 2)
    gain, fall = np.vstack([walls, np.repeat(tops, 4, axis=0)]).T.copy()
    top_gain, top_fall = tops.T.copy()
    return gain, fall, top_gain, top_fall


def _is_convex(outline_m: F64) -> bool:
    along = np.roll(outline_m, -1, axis=0) - outline_m
    onward = np.roll(along, -1, axis=0)
    return bool((along[:, 0] * onward[:, 1] - along[:, 1] * onward[:, 0] >= -1e-12).all())


def _grid(room: Room, corners: F64) -> tuple[float, F64, I64, I64, I64]:
    """Cell size, origin (2), shape (2) and each cell's blocks: all whose box in plan touches it."""
    extent = np.ptp(room.outline_m, axis=0)
    cell_m = CELL_M if len(corners) > FEW_BLOCKS else float(extent.max()) + 3 * CELL_M
    origin = room.corner_m - CELL_M
    shape = np.ceil((extent + 2 * CELL_M) / cell_m).astype(np.int64)
    cells: list[list[int]] = [[] for _ in range(int(shape[0] * shape[1]))]
    for k, corner in enumerate(corners):
        low = np.floor((corner.min(axis=0) - origin) / cell_m - 1e-9).astype(int)
        high = np.floor((corner.max(axis=0) - origin) / cell_m + 1e-9).astype(int)
        low, high = np.clip(low, 0, shape - 1), np.clip(high, 0, shape - 1)
        for x in range(low[0], high[0] + 1):
            for y in range(low[1], high[1] + 1):
                cells[x * int(shape[1]) + y].append(k)
    start = np.cumsum([0, *[len(cell) for cell in cells]]).astype(np.int64)
    return cell_m, origin, shape, start, np.array(list(chain(*cells)), dtype=np.int64)


def _clutter(room: Room) -> tuple[F64, F64, F64]:
    """Points (s, 3), outward normals (s, 3) and radii (s) of blocks and of rough surfaces."""
    parts = [_block_clutter(block, room.seed) for block in room.blocks]
    parts += _texture(room)
    nothing = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    point, normal, radius = (np.concatenate(part) for part in zip(nothing, *parts, strict=True))
    return point, normal, radius


def _generator(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def _block_clutter(block: Block, seed: int) -> tuple[F64, F64, F64]:
    """Points on the sides and the top of a block, the same wherever it stands."""
    generator = _generator(seed, block.name)
    length, width, height = block.size_m
    areas = np.array(
        [length * width, length * height, length * height, width * height, width * height]
    )
    count = round(float(areas.sum()) * block.clutter_per_m2)
    face = generator.choice(5, size=count, p=areas / areas.sum())
    share = generator.uniform(0.0, 1.0, (count, 3)) - [0.5, 0.5, 0.0]
    share[face == 0, 2] = 1.0
    share[face == 1, 1], share[face == 2, 1] = -0.5, 0.5
    share[face == 3, 0], share[face == 4, 0] = -0.5, 0.5
    outward = np.array([[0, 0, 1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]], dtype=float)[face]
    normal = np.column_stack([block.turn(outward[:, :2]), outward[:, 2]])
    point = block.place(share * block.size_m) + OUTSIDE_M * normal
    return point, normal, generator.uniform(*CLUTTER_RADIUS_M, count)


def _texture(room: Room) -> list[tuple[F64, F64, F64]]:
    """Points on walls, floor and ceiling whose strength adds up to the diffuse reflection.

    A point of radius a sends pi a^2 / 2 of the incident intensity into the half-space.
    """
    ends = zip(room.outline_m, np.roll(room.outline_m, -1, axis=0), room.walls, strict=True)
    parts = [
        _wall_texture(a, b, room.height_m, surface, _generator(room.seed, f"wall {k}"))
        for k, (a, b, surface) in enumerate(ends)
    ]
    for name, surface, z in (("floor", room.floor, 0.0), ("ceiling", room.ceiling, room.height_m)):
        generator = _generator(room.seed, name)
        extent = np.ptp(room.outline_m, axis=0)
        count = round(float(np.prod(extent)) * TEXTURE_PER_M2)
        xy = room.corner_m + generator.uniform(0, 1, (count, 2)) * extent
        xy = xy[room.holds(xy)]
        up = 1.0 if z == 0 else -1.0
        normal = np.tile([0.0, 0.0, up], (len(xy), 1))
        point = np.column_stack([xy, np.full(len(xy), z)]) + OUTSIDE_M * normal
        parts.append((point, normal, _texture_radius(surface, len(xy))))
    return [part for part in parts if part[2].any()]


def _wall_texture(
    a: F64, b: F64, height_m: float, surface: Material, generator: np.random.Generator
) -> tuple[F64, F64, F64]:
    length = float(np.linalg.norm(b - a))
    count = round(length * height_m * TEXTURE_PER_M2)
    share = generator.uniform(0.0, 1.0, (count, 2))
    inward = np.array([-(b - a)[1], (b - a)[0], 0.0]) / length
    xy = a + share[:, :1] * (b - a)
    point = np.column_stack([xy, share[:, 1] * height_m]) + OUTSIDE_M * inward
    return point, np.tile(inward, (count, 1)), _texture_radius(surface, count)


def _texture_radius(surface: Material, count: int) -> F64:
    return np.full(count, np.sqrt(2 * surface.diffuse / (np.pi * TEXTURE_PER_M2)))


def _edges(room: Room) -> tuple[F64, F64, F64]:
    """Upright and top edges of the blocks (e, 3), (e, 3) and the directions they point to."""
    a, b, normal = [], [], []
    for block in room.blocks:
        if block.base_m <= 0 and block.top_m >= room.height_m and block.clutter_per_m2 == 0:
            continue
        half = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
        low = block.place(np.column_stack([half * block.size_m[:2], np.zeros(4)]))
        high = low + np.array([0.0, 0.0, block.size_m[2]])
        outward = block.turn(np.sign(half)) / np.sqrt(2)
        a += [low, high]
        b += [high, np.roll(high, -1, axis=0)]
        side = (outward + np.roll(outward, -1, axis=0)) / np.sqrt(2)
        normal += [
            np.column_stack([outward, np.zeros(4)]),
            np.column_stack([side, np.ones(4)]) / np.sqrt(2),
        ]
    stack = [np.concatenate(part) if part else np.zeros((0, 3)) for part in (a, b, normal)]
    return stack[0], stack[1], stack[2]
