"""Scenes: faces look into the air, cells list their blocks, clutter belongs to its block."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elfslam.base.arrays import F64
from elfslam.world.materials import Material, material
from elfslam.world.room import Block, Room, box
from elfslam.world.scene import CLUTTER_RADIUS_M, FEW_BLOCKS, OUTSIDE_M, TEXTURE_PER_M2, scene_of

ELL_M = np.array([[0, 0], [6, 0], [6, 3], [3, 3], [3, 5], [0, 5]], dtype=float)
PLAIN = Material("plain", 0.3, 0.0, "planted")
ROUGH = Material("rough", 0.2, 0.25, "planted")
TABLE = box("table", [1.0, 1.0, 0.0], [1.5, 0.8, 0.7], material("wood furniture"), 0.4)
SHELF = box("shelf", [4.0, 2.4, 0.0], [1.0, 0.4, 1.8], material("book shelf"))


def ell(*blocks: Block, surface: Material = PLAIN, seed: int = 0) -> Room:
    walls = tuple(Material(f"{k}", k / 10, 0.0, "planted") for k in range(6))
    if surface is not PLAIN:
        walls = (surface,) * 6
    return Room(ELL_M, 2.5, walls, surface, surface, blocks, seed)


def test_faces_of_the_room_look_inward_and_those_of_blocks_outward() -> None:
    room = ell(TABLE, SHELF)
    scene = scene_of(room)
    before = (scene.face_a + scene.face_b) / 2 + 0.01 * scene.face_normal
    assert scene.outer == 6
    assert scene.face_block.tolist() == [-1] * 6 + [0] * 4 + [1] * 4
    assert room.holds(before).all()
    assert room.is_free(before, 0.5).all(), "just before a face there is air"
    behind = before - 0.02 * scene.face_normal
    assert not room.holds(behind[:6]).any()
    assert not room.is_free(behind[6:], 0.5).any()


def test_every_face_has_its_gain() -> None:
    scene = scene_of(ell(TABLE, SHELF))
    walls = [np.sqrt(1 - k / 10) for k in range(6)]
    blocks = np.repeat([TABLE.surface.reflection, SHELF.surface.reflection], 4)
    np.testing.assert_allclose(scene.face_gain, np.append(walls, blocks))
    assert scene.block_high.tolist() == [0.7, 1.8]
    assert scene.floor_gain == scene.ceiling_gain == pytest.approx(np.sqrt(0.7))


@pytest.mark.parametrize(("outline", "expected"), [(ELL_M, False), (ELL_M[[0, 1, 2, 4, 5]], True)])
def test_only_convex_rooms_are_convex(outline: F64, expected: bool) -> None:
    room = Room(outline, 2.5, (PLAIN,) * len(outline), PLAIN, PLAIN)
    assert scene_of(room).convex == expected


@settings(max_examples=30)
@given(
    xy_m=st.tuples(st.floats(0, 6), st.floats(0, 5)),
    turn_rad=st.floats(0, 3.2),
    length_m=st.floats(0.1, 4.0),
    others=st.sampled_from([0, FEW_BLOCKS]),
)
def test_every_point_of_a_block_lies_in_a_cell_that_lists_it(
    xy_m: tuple[float, float], turn_rad: float, length_m: float, others: int
) -> None:
    """Few blocks share one cell; with many there are cells of a metre."""
    block = Block("crate", PLAIN, np.array(xy_m), [length_m, 0.7, 1.0], turn_rad)
    scene = scene_of(ell(*(SHELF,) * others, block))
    assert (scene.grid_shape.prod() > 1) == (others > 0)
    local = np.random.default_rng(1).uniform(-0.5, 0.5, (100, 3)) * block.size_m
    points = block.place(local)[:, :2]
    cells = np.floor((points - scene.grid_origin) / scene.cell).astype(int)
    within = ((cells >= 0) & (cells < scene.grid_shape)).all(axis=1)
    for x, y in cells[within]:
        cell = x * scene.grid_shape[1] + y
        listed = scene.cell_block[scene.cell_start[cell] : scene.cell_start[cell + 1]]
        assert others in listed


def local_of(points: F64, block: Block) -> F64:
    cos, sin = np.cos(block.turn_rad), np.sin(block.turn_rad)
    planar = (points[:, :2] - block.centre_m) @ np.array([[cos, -sin], [sin, cos]])
    return np.column_stack([planar, points[:, 2] - block.base_m])


def test_clutter_lies_just_off_the_visible_faces() -> None:
    scene = scene_of(ell(TABLE))
    local = local_of(scene.point - OUTSIDE_M * scene.point_normal, TABLE)
    length, width, height = TABLE.size_m
    on = np.column_stack(
        [np.abs(np.abs(local[:, 0]) - length / 2), np.abs(np.abs(local[:, 1]) - width / 2),
         np.abs(local[:, 2] - height)]
    )  # fmt: skip
    assert (on.min(axis=1) < 1e-9).all()
    visible = length * width + 2 * (length + width) * height
    assert len(local) == round(visible * TABLE.clutter_per_m2)
    assert scene.point_radius.min() >= CLUTTER_RADIUS_M[0]
    assert scene.point_radius.max() <= CLUTTER_RADIUS_M[1]
    outside = local_of(scene.point + 0.1 * scene.point_normal, TABLE)
    in_plan = (np.abs(outside[:, :2]) < TABLE.size_m[:2] / 2).all(axis=1)
    assert not (in_plan & (outside[:, 2] < height)).any(), "normals look away from the block"


def test_clutter_moves_with_its_block_and_leaves_the_others_alone() -> None:
    moved = replace(TABLE, centre_m=[3.0, 1.5], turn_rad=1.3, base_m=0.2)
    before, after = scene_of(ell(TABLE, SHELF)), scene_of(ell(moved, SHELF))
    count = len(scene_of(ell(TABLE)).point)
    np.testing.assert_allclose(
        local_of(before.point[:count], TABLE), local_of(after.point[:count], moved), atol=1e-9
    )
    assert (before.point[count:] == after.point[count:]).all()
    assert (before.point_radius == after.point_radius).all()


def test_rough_surfaces_return_their_diffuse_share() -> None:
    """A point of radius a sends pi a^2 / 2 of the incident intensity into the half-space."""
    scene = scene_of(ell(surface=ROUGH))
    outline_m = np.linalg.norm(np.roll(ELL_M, -1, axis=0) - ELL_M, axis=1).sum()
    area_m2 = 2 * 24.0 + outline_m * 2.5
    returned = (np.pi * scene.point_radius**2 / 2).sum()
    assert len(scene.point) == pytest.approx(area_m2 * TEXTURE_PER_M2, rel=0.15)
    assert returned == pytest.approx(area_m2 * ROUGH.diffuse, rel=0.15)
    assert ell().holds(scene.point[:, :2] + 0.0).all()


def test_furniture_has_upright_and_top_edges_and_a_plain_pillar_has_none() -> None:
    pillar = box("pillar", [1.0, 1.0, 0.0], [0.4, 0.4, 2.5], PLAIN, 0.0, 0.0)
    scene = scene_of(ell(TABLE, pillar))
    assert len(scene.edge_a) == 8
    upright = scene.edge_a[:, :2] == scene.edge_b[:, :2]
    assert upright.all(axis=1).sum() == 4
    np.testing.assert_allclose(np.linalg.norm(scene.edge_normal, axis=1), 1.0)
    middle = (scene.edge_a + scene.edge_b) / 2
    out = local_of(middle + 0.1 * scene.edge_normal, TABLE)
    assert not ((np.abs(out) < TABLE.size_m / 2).all(axis=1) & (out[:, 2] < 0.7)).any()
