"""Surfaces and what they scatter: patches that cover all of it, and chains as radiosity has it."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world import scattering as scatter
from elfslam.world.materials import Material
from elfslam.world.patches import PATCH_M, boxes_of, faces_and_patches, first_face, patch_at, uneven
from elfslam.world.room import Room, box, shoebox

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

    before, after = before.point[before.face >= 6], after.point[after.face >= 6]
    assert after - before == pytest.approx(np.broadcast_to([0.3, 0.3, 0], before.shape))


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


SIZE_M = np.array([6.0, 4.0, 3.0])
ROUGH = Material("rough", 0.2, 1.0, "all that it keeps it scatters")


def room_of(surface: Material = ROUGH, seed: int = 3) -> Room:
    return shoebox(SIZE_M, (surface,) * 6, (), seed)


def rows_of(scattering: scatter.Scattering) -> np.ndarray:
    """First patch, last patch, length, gain and fall of every chain."""
    chains = scattering.chains
    first = np.repeat(np.arange(len(scattering.once)), np.diff(chains.start))
    return np.column_stack([first, chains.to, chains.length, chains.gain, chains.fall])


def test_a_patch_scatters_what_it_keeps() -> None:
    scattering = scatter.scattering_of(room_of())
    assert scattering.once**2 * np.pi == pytest.approx(0.8 * scattering.patches.area)
    signs = np.sign(scattering.once)
    assert abs(signs.mean()) < 0.2


def test_every_chain_leads_both_ways() -> None:
    """Reciprocity."""
    rows = rows_of(scatter.scattering_of(room_of()))
    back = rows[:, [1, 0, 2, 3, 4]]
    assert rows[np.lexsort(rows.T)] == pytest.approx(back[np.lexsort(back.T)])


def test_chains_of_a_patch_come_by_length() -> None:
    chains = scatter.scattering_of(room_of()).chains
    for a, b in zip(chains.start[:-1], chains.start[1:], strict=True):
        assert (np.diff(chains.length[a:b]) >= 0).all()
    assert chains.length.max() <= scatter.LONGEST_M


def test_second_order_has_the_energy_of_what_arrives() -> None:
    """In a closed room all that leaves a patch arrives at another, which keeps 0.8 of it.

    Its chains of two scatterings are the particles' first: a particle in n, each with what the
    patch scattered by pi. Longer chains carry 0.8 of the last one each, by then not all in reach.
    """
    scattering = scatter.scattering_of(room_of())
    rows = rows_of(scattering)
    energy = (rows[:, 3] ** 2).sum()
    once = (scattering.once**2).sum()
    short = rows[rows[:, 2] < 3.0]
    assert 0.8 * once < energy < 0.8 / (1 - 0.8) * once
    assert (short[:, 3] ** 2).sum() < 0.8 * once


def test_energy_decays_by_absorption_and_mean_free_path() -> None:
    """Oracle: Eyring, ln(kept) per mean free path 4 V / S."""
    rows = rows_of(scatter.scattering_of(room_of()))
    bins = np.arange(6.0, 20.0, 1.0)
    energy = np.histogram(rows[:, 2], bins, weights=rows[:, 3] ** 2)[0]
    slope = np.polyfit(bins[:-1], np.log(energy), 1)[0]
    volume, surface = SIZE_M.prod(), 2 * (24 + 18 + 12)
    assert slope == pytest.approx(np.log(0.8) * surface / (4 * volume), rel=0.25)


def test_what_scattering_takes_from_mirrors_it_gives_to_the_field() -> None:
    """Where nothing is absorbed the energy of chains is the same at every frequency, long or short.

    Chain by chain it is not: some fall with the frequency, and others grow.
    """
    for share in (0.3, 0.6):
        bright = Material("bright", 0.0, share, "planted")
        rooms = [scatter.scattering_of(room_of(bright, seed)).chains for seed in range(4)]
        for low, high in ((0.0, 8.0), (8.0, 14.0), (14.0, 21.0)):
            falls = []
            for chains in rooms:
                of = (chains.length >= low) & (chains.length < high)
                falls.append(np.average(chains.fall[of], weights=chains.gain[of] ** 2))
                assert chains.fall[of].std() > 0.4
            assert abs(np.mean(falls)) < 0.08


def test_absorption_makes_chains_fall_with_every_reflection() -> None:
    """In a room that scatters all that it keeps, by the same for each of their patches."""
    rows = scatter.scattering_of(room_of()).chains
    steps = rows.fall / (0.5 * 0.2 / (2 * 0.8))
    assert steps == pytest.approx(np.round(steps), abs=1e-4)
    assert steps.min() == pytest.approx(2.0, abs=1e-4)
    assert np.corrcoef(steps, rows.length)[0, 1] > 0.5


def test_mirroring_between_scatterings_adds_to_the_way_and_not_to_the_chains() -> None:
    half = replace(ROUGH, scattering=0.5)
    few, many = (len(scatter.scattering_of(room_of(each)).chains.to) for each in (half, ROUGH))
    assert 0.3 < few / many < 0.7


def test_the_same_room_has_the_same_chains_and_another_seed_others() -> None:
    one, again, other = (scatter.scattering_of(room_of(seed=seed)) for seed in (3, 3, 4))
    assert (rows_of(one) == rows_of(again)).all()
    assert len(rows_of(one)) != len(rows_of(other)) or (rows_of(one) != rows_of(other)).any()


def test_a_thing_that_moves_changes_only_what_meets_it() -> None:
    """Of a small box in a room, most chains never hear."""
    thing = box("thing", np.array([1.0, 1.0, 0.0]), np.array([0.4, 0.4, 0.4]), ROUGH)
    moved = replace(thing, centre_m=thing.centre_m + np.array([0.2, 0.0]))
    rooms = [replace(room_of(), blocks=(each,)) for each in (thing, moved)]
    lengths = [np.unique(rows_of(scatter.scattering_of(room))[:, 2]) for room in rooms]
    common = len(np.intersect1d(*lengths)) / max(map(len, lengths))
    assert 0.6 < common < 1.0


def test_measured_surfaces_scatter_and_absorb_at_least_so_much() -> None:
    room = scatter.as_measured(room_of(Material("mirror", 0.0, 0.0, "planted")))
    assert all(side.scattering > 0.2 and side.absorption > 0.02 for side in room.walls)
    assert scatter.as_measured(room_of()).walls == room_of().walls


def test_a_bare_surface_and_its_fittings_scatter_one_after_the_other() -> None:
    """What fittings leave is mirrored by the bare surface, less what its roughness scatters."""
    for name, fittings in (
        (next(iter(scatter.FITTINGS)), scatter.FITTINGS["glass"]),
        ("planted", scatter.OTHER_FITTINGS),
    ):
        room = scatter.as_measured(room_of(Material(name, 0.1, 0.4, "planted")))
        mirrored = 0.6 * (1 - fittings)
        assert [1 - side.scattering for side in room.walls] == pytest.approx([mirrored] * 4)


def test_the_field_falls_by_absorption_and_mean_free_path() -> None:
    """Oracle: Eyring at two frequencies, with absorption as the root of the frequency."""
    chains = scatter.scattering_of(room_of()).chains
    step = 1e-3
    nepers = [-0.5 * np.log(1 - 0.2 * np.sqrt(1 + sign * step)) for sign in (-1, 1)]
    a_metre = (nepers[1] - nepers[0]) / (2 * step) * 2 * (24 + 18 + 12) / (4 * SIZE_M.prod())
    late = chains.length > 5.0
    slope = np.polyfit(chains.length[late], chains.fall[late], 1, w=np.abs(chains.gain[late]))[0]
    assert slope == pytest.approx(a_metre, rel=0.15)
