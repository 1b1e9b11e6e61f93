"""Patches of a room's surface: all of it and nothing that is covered; what rays meet."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world.materials import Material
from elfslam.world.patches import PATCH_M, boxes_of, faces_and_patches, first_face, patch_at, uneven
from elfslam.world.room import Room, box, shoebox

SIZE_M = np.array([6.0, 4.0, 3.0])
SURFACES = tuple(Material(f"side {k}", 0.1 * k, 0.05 * k, "planted") for k in range(6))
CUPBOARD = box("cupboard", np.array([2.0, 1.0, 0.0]), np.array([1.0, 2.0, 1.5]))


def empty(seed: int = 3) -> Room:
    return shoebox(SIZE_M, SURFACES, (), seed)


def furnished(*blocks: object) -> Room:
    return shoebox(SIZE_M, SURFACES, blocks or (CUPBOARD,), 3)


def met(room: Room, start: F64, way: F64) -> tuple[int, float]:
    faces, _ = faces_and_patches(room)
    found, far = first_face(faces, boxes_of(room), len(room.walls), *start, *way)
    return int(found), float(far)


def test_an_empty_room_is_patches_all_over() -> None:
    faces, patches = faces_and_patches(empty())
    assert patches.area.sum() == pytest.approx(2 * (24 + 18 + 12))
    assert (patches.area <= PATCH_M**2 + 1e-9).all()
    assert faces.kept.tolist() == pytest.approx([0.8, 0.9, 0.7, 1.0, 0.6, 0.5])  # S E N W, up, down


def test_each_point_lies_in_its_own_cell_and_its_air_is_in_the_room() -> None:
    faces, patches = faces_and_patches(furnished())
    for k in range(len(patches.area)):
        assert patch_at(faces, patches.face[k], *patches.point[k]) == k
    inward = (patches.point + 0.02 * patches.normal)[patches.face < 6]
    assert ((inward > 0) & (inward < SIZE_M)).all()


def test_what_is_covered_has_no_patch() -> None:
    _, bare = faces_and_patches(empty())
    faces, patches = faces_and_patches(furnished())
    on_floor, bare_floor = patches.area[patches.face == 4].sum(), bare.area[bare.face == 4].sum()
    assert on_floor == pytest.approx(bare_floor - 2.0, abs=1.0)
    sides = patches.area[patches.face >= 6].sum()
    assert sides == pytest.approx(2 * 1.5 * (1 + 2) + 2.0)  # it stands: no underside
    assert patch_at(faces, 4, 2.5, 2.0, 0.0) == -1


def test_patches_of_a_face_are_its_own_whatever_else_moves() -> None:
    moved = replace(CUPBOARD, centre_m=CUPBOARD.centre_m + 0.3)
    _, before = faces_and_patches(furnished())
    _, after = faces_and_patches(furnished(moved))
    assert (before.point[before.face == 0] == after.point[after.face == 0]).all()
    of_block = before.point[before.face >= 6], after.point[after.face >= 6]
    assert of_block[1] - of_block[0] == pytest.approx(
        np.broadcast_to([0.3, 0.3, 0], of_block[0].shape)
    )


def test_a_block_is_met_first_and_by_the_side_it_shows() -> None:
    start = np.array([1.0, 2.0, 1.2])
    assert met(furnished(), start, np.array([1.0, 0, 0])) == (6, pytest.approx(1.0))
    assert met(furnished(), start, np.array([1.0, 0.0, 0.34]) / np.hypot(1, 0.34))[0] == 1
    above = np.array([1.0, 2.0, 1.6])
    assert met(furnished(), above, np.array([1.5, 0.0, -0.11]) / np.hypot(1.5, 0.11))[0] == 11


def test_random_rays_in_a_room_meet_its_surface() -> None:
    """Oracle: the nearest of the six planes, by plain arithmetic."""
    generator = np.random.default_rng(5)
    for _ in range(200):
        start, way = generator.uniform(0.1, 0.9, 3) * SIZE_M, generator.normal(size=3)
        way /= np.linalg.norm(way)
        low, high = -start / way, (SIZE_M - start) / way
        planes = np.array([low[1], high[0], high[1], low[0], low[2], high[2]])
        planes[planes < 0] = np.inf
        assert met(empty(), start, way) == (int(planes.argmin()), pytest.approx(planes.min()))


@pytest.mark.parametrize("share", [0.1, 0.3, 0.8])
def test_uneven_shares_keep_their_mean(share: float) -> None:
    shares = uneven(np.full(20_000, share), np.random.default_rng(0).uniform(size=20_000))
    assert shares.mean() == pytest.approx(share, abs=0.01)
    assert shares.std() > 0.5 * share * (1 - share)
    assert (shares >= 0).all()
    assert (shares <= 1).all()
