"""Rooms: scatterers lie on the visible faces of furniture that stands inside."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.world.room import (
    SCATTERER_RADIUS_M,
    SCATTERERS_PER_M2,
    Furniture,
    Room,
    furnish,
)

SIZE_M = np.array([6.0, 4.0, 2.5])
REFLECTION = np.full(6, 0.8)
BOX = Furniture("box", np.array([1.0, 2.0, 0.0]), np.array([2.0, 1.0, 0.5]))
SHELF = Furniture("shelf", np.array([0.0, 0.0, 1.2]), np.array([0.8, 2.5, 1.0]))


def furnished(*items: Furniture, seed: int = 0) -> Room:
    return furnish(SIZE_M, REFLECTION, items, np.random.default_rng(seed))


def faces_touched(points: F64, item: Furniture) -> F64:
    """Which of x-, x+, y-, y+, z-, z+ each point (n, 3) lies on: (n, 6)."""
    low, high = item.corner_m, item.corner_m + item.size_m
    near = np.stack([np.abs(points - low) < 1e-9, np.abs(points - high) < 1e-9], axis=2)
    return near.reshape(len(points), 6)


@pytest.mark.parametrize("item", [BOX, SHELF], ids=lambda item: item.name)
def test_scatterers_lie_on_the_five_visible_faces(item: Furniture) -> None:
    points = furnished(item).scatterers_m
    touched = faces_touched(points, item)
    assert (points >= item.corner_m - 1e-9).all()
    assert (points <= item.corner_m + item.size_m + 1e-9).all()
    assert touched[:, [0, 1, 2, 3, 5]].any(axis=1).all()
    assert touched[:, [0, 1, 2, 3, 5]].any(axis=0).all(), "every visible face carries some"


def test_scatterers_are_as_dense_as_the_surface_is_large() -> None:
    visible_m2 = 2.0 * 1.0 + 2 * 2.0 * 0.5 + 2 * 1.0 * 0.5
    room = furnished(BOX)
    assert len(room.scatterers_m) == round(visible_m2 * SCATTERERS_PER_M2)
    assert room.scatterer_radius_m.min() >= SCATTERER_RADIUS_M[0]
    assert room.scatterer_radius_m.max() <= SCATTERER_RADIUS_M[1]


def test_the_large_face_carries_the_larger_share() -> None:
    table = Furniture("table", np.zeros(3), np.array([6.0, 4.0, 0.1]))
    touched = faces_touched(furnished(table).scatterers_m, table)
    assert touched[:, 5].mean() > 0.8  # the top is 24 of 26 m2


def test_a_seed_gives_one_room() -> None:
    first, again, other = furnished(BOX, SHELF), furnished(BOX, SHELF), furnished(BOX, seed=1)
    assert (first.scatterers_m == again.scatterers_m).all()
    assert (first.scatterer_radius_m == again.scatterer_radius_m).all()
    assert not np.isin(other.scatterers_m, first.scatterers_m).all()


def test_an_empty_room_scatters_nothing() -> None:
    room = furnished()
    assert room.scatterers_m.shape == (0, 3)
    assert room.outline_m.tolist() == [[0, 0], [6, 0], [6, 4], [0, 4]]


@pytest.mark.parametrize(
    ("corner_m", "size_m"),
    [
        ([-0.1, 0, 0], [1, 1, 1]),
        ([0, 0, -0.1], [1, 1, 1]),
        ([5.5, 0, 0], [1, 1, 1]),
        ([0, 3.5, 0], [1, 1, 1]),
        ([0, 0, 0], [1, 1, 2.6]),
    ],
)
def test_furniture_outside_the_room_is_refused(corner_m: list[float], size_m: list[float]) -> None:
    with pytest.raises(InputError, match=r"furniture 'sofa' stands outside the room; move"):
        furnished(Furniture("sofa", np.array(corner_m, float), np.array(size_m, float)))


def test_furniture_may_touch_the_walls() -> None:
    whole = Furniture("whole", np.zeros(3), SIZE_M)
    assert furnished(whole).furniture == (whole,)
