"""Paths in plan, against the lattice of a rectangle and against trying every order of faces."""

from itertools import product

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world.materials import Material
from elfslam.world.paths import PlanPaths, Reach, find_paths, make_plan_paths
from elfslam.world.room import Block, Room, box, shoebox
from elfslam.world.scene import Scene, scene_of

NOBODY = np.zeros((0, 2))
HALF = Material("half", 0.75, 0.0, "reflects half of the pressure")
RECTANGLE_M = np.array([7.0, 5.0])
SOURCE_M, TARGET_M = np.array([2.3, 1.9, 1.2]), np.array([4.1, 3.2, 1.6])


def found(
    scene: Scene, reach: Reach, source: F64 = SOURCE_M, target: F64 = TARGET_M
) -> tuple[PlanPaths, int]:
    paths = make_plan_paths(len(scene.block_low))
    return paths, int(find_paths(scene, NOBODY, paths, source, target, reach))


def rectangle(*blocks: Block) -> Scene:
    return scene_of(shoebox(np.append(RECTANGLE_M, 3.0), (HALF,) * 6, blocks))


def pillar(x: float, y: float, size: float = 0.4, turn: float = 0.3, top: float = 3.0) -> Block:
    return Block("pillar", HALF, [x, y], [size, size, top], turn, 0.0, 0.0)


@pytest.mark.parametrize("order", [0, 1, 3, 6])
def test_a_rectangle_gives_the_lattice_of_its_images(order: int) -> None:
    reach = Reach(longest_m=18.0, order=order, plan_order=order)
    expected = []
    for n in product(range(-order, order + 1), repeat=2):
        for odd in product(range(2), repeat=2):
            away, flip = np.array(n), np.array(odd)
            bounces = int((np.abs(away - flip) + np.abs(away)).sum())
            image = (1 - 2 * flip) * SOURCE_M[:2] + 2 * away * RECTANGLE_M
            length = float(np.linalg.norm(image - TARGET_M[:2]))
            if bounces <= order and length <= 18.0:
                expected.append((length, bounces))
    paths, count = found(rectangle(), reach)
    ours = sorted(zip(paths.length[:count], paths.order[:count], strict=True))
    np.testing.assert_allclose(ours, sorted(expected))
    np.testing.assert_allclose(paths.gain[:count], 0.5 ** paths.order[:count])


def test_directions_point_along_the_path() -> None:
    """By the wall y = 0: the way out mirrors the way home."""
    paths, count = found(rectangle(), Reach(order=1, plan_order=1))
    image = SOURCE_M[:2] * [1, -1]
    length = np.linalg.norm(image - TARGET_M[:2])
    p = int(np.abs(paths.length[:count] - length).argmin())
    np.testing.assert_allclose(paths.arrival[p], (image - TARGET_M[:2]) / length)
    np.testing.assert_allclose(paths.departure[p], (TARGET_M[:2] * [1, -1] - SOURCE_M[:2]) / length)


def every_order_of_faces(scene: Scene, source: F64, target: F64, reach: Reach) -> F64:
    """Lengths of all specular paths: each order of faces is mirrored and every leg checked."""
    lengths = []
    for order in range(reach.plan_order + 1):
        for faces in product(range(len(scene.face_gain)), repeat=order):
            length = specular_length(scene, source, target, faces)
            if length is not None and length <= reach.longest_m:
                lengths.append(length)
    return np.sort(lengths)


def specular_length(scene: Scene, source: F64, target: F64, faces: tuple[int, ...]) -> float | None:
    images = [source]
    for f in faces:
        a, normal = scene.face_a[f], scene.face_normal[f]
        if normal.dot(images[-1] - a) <= 0:
            return None
        images.append(images[-1] - 2 * normal.dot(images[-1] - a) * normal)
    here, onto = target, -1
    for f, image in zip(reversed(faces), reversed(images[1:]), strict=True):
        hit = crossing_of(here, image, scene.face_a[f], scene.face_b[f])
        if hit is None or scene.face_normal[f].dot(here - scene.face_a[f]) <= 0:
            return None
        if leg_is_cut(scene, here, hit, (onto, f)):
            return None
        here, onto = hit, f
    if leg_is_cut(scene, here, source, (onto,)):
        return None
    return float(np.linalg.norm(images[-1] - target))


def crossing_of(p: F64, q: F64, a: F64, b: F64) -> F64 | None:
    """Where segments pq and ab cross, or None."""
    matrix = np.column_stack([q - p, a - b])
    if abs(np.linalg.det(matrix)) < 1e-12:
        return None
    shares = np.linalg.solve(matrix, a - p)
    within = (shares >= 0).all() and (shares <= 1).all()
    return np.asarray(p + shares[0] * (q - p)) if within else None


def leg_is_cut(scene: Scene, p: F64, q: F64, own: tuple[int, ...]) -> bool:
    return any(
        f not in own and crossing_of(p, q, scene.face_a[f], scene.face_b[f]) is not None
        for f in range(len(scene.face_gain))
    )


def rooms() -> list[Room]:
    ell = np.array([[0, 0], [6, 0], [6, 3], [3, 3], [3, 5], [0, 5]], dtype=float)
    dart = np.array([[0, 0], [6, 1], [5, 5], [2.5, 3.2], [0.5, 5.5]], dtype=float)
    walls = Material("wall", 0.3, 0.0, "planted")
    return [
        Room(ell, 3.0, (walls,) * 6, walls, walls, (pillar(1.5, 3.5), pillar(4.5, 1.2))),
        Room(dart, 3.0, (walls,) * 5, walls, walls, (pillar(1.9, 2.0, 0.7),)),
        Room(ell, 3.0, (walls,) * 6, walls, walls),
    ]


@pytest.mark.parametrize("which", range(3))
def test_every_path_is_found_and_no_other(which: int) -> None:
    room = rooms()[which]
    scene, reach = scene_of(room), Reach(15.0, 3, 3, 3, 3)
    generator = np.random.default_rng(which)
    tried = 0
    while tried < 3:
        source, target = room.corner_m + generator.uniform(0, 1, (2, 2)) * room.size_m[:2]
        if not room.is_free(np.array([source, target]), 1.0, 0.05).all():
            continue
        tried += 1
        expected = every_order_of_faces(scene, source, target, reach)
        paths, count = found(scene, reach, source, target)
        np.testing.assert_allclose(np.sort(paths.length[:count]), expected, atol=1e-9)
        assert count > 0


@pytest.mark.parametrize(
    ("changed", "on_blocks"),
    [
        ({"block_order": 0}, []),
        ({"block_order": 1, "beside_block": 1}, [(1, 1)]),
        ({"block_order": 1, "beside_block": 2}, [(1, 1), (1, 2)]),
        ({"block_order": 2, "beside_block": 2}, [(1, 1), (1, 2), (2, 2)]),
    ],
)
def test_block_reflections_end(changed: dict[str, int], on_blocks: list[tuple[int, int]]) -> None:
    """Two mirrors that face each other; pairs of (reflections at blocks, in plan)."""
    places = ("a", [1.0, 1.0, 0.0]), ("b", [5, 1, 0])
    blocks = [box(*place, [0.2, 3.0, 3.0], HALF) for place in places]
    reach = Reach(order=3, plan_order=3)._replace(**changed)
    paths, count = found(rectangle(*blocks), reach)
    kinds = set()
    for p in range(count):
        at_blocks = int((paths.hit_block[p, : paths.order[p]] >= 0).sum())
        if at_blocks:
            kinds.add((at_blocks, int(paths.order[p])))
    assert sorted(kinds) == on_blocks


def test_a_low_block_leaves_the_path_and_is_noted_on_it() -> None:
    high, low = rectangle(pillar(3.2, 2.55)), rectangle(pillar(3.2, 2.55, top=1.0))
    reach = Reach(order=0, plan_order=0)
    assert found(high, reach)[1] == 0
    paths, count = found(low, reach)
    assert (count, int(paths.crossing_end[0])) == (1, 1)
    assert paths.crossings.high[0] == 1.0
    assert paths.crossings.enter[0] < np.linalg.norm((SOURCE_M - TARGET_M)[:2]) / 2


def test_hits_are_noted_from_the_start() -> None:
    shelf = box("shelf", [6.0, 1.0, 0.0], [0.2, 3.5, 3.0], HALF)
    paths, count = found(rectangle(shelf), Reach(order=1, plan_order=1))
    (p,) = np.flatnonzero(paths.hit_block[:count, 0] == 0)[-1:]
    share = (6.0 - SOURCE_M[0]) / (12.0 - SOURCE_M[0] - TARGET_M[0])
    assert paths.hit_at[p, 0] == pytest.approx(share * paths.length[p])


def test_more_than_fits_is_reported() -> None:
    """Low blocks on every way through a narrow room are noted for each of them."""
    size_m = [0.01, 1.0, 0.5]
    strips = tuple(box(f"{k}", [0.02 + 0.03 * k, 0, 0], size_m, HALF) for k in range(30))
    scene = scene_of(shoebox(np.array([1.0, 1.0, 3.0]), (HALF,) * 6, strips))
    source, target = np.array([0.3, 0.4, 1.0]), np.array([0.6, 0.3, 1.0])
    reach = Reach(longest_m=5.0, order=24, plan_order=3, block_order=0)
    assert found(scene, reach, source, target)[1] == 25
    assert found(scene, reach._replace(longest_m=60.0, plan_order=24), source, target)[1] == -1
