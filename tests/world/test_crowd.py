"""People who scatter: points on their cylinders, as loud as the law says, and what hides them."""

from __future__ import annotations

import numpy as np
import pytest
from one_phone import AIR, DEAD, SIZE_M, X, dead_room, ends_at

from elfslam.base.arrays import F64
from elfslam.world.device import BAND_BINS
from elfslam.world.diffuse import (
    POINTS,
    SCATTERING_M,
    Crowd,
    add_diffuse,
    diffuse_echoes,
    make_crowd,
    stand,
)
from elfslam.world.materials import Material, material
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers
from elfslam.world.plan import PERSON_RADIUS_M
from elfslam.world.pulses import BASEBAND_HZ, C64
from elfslam.world.room import Room, box, shoebox
from elfslam.world.scattering import scattering_of
from elfslam.world.scene import scene_of

PERSON = material("person")
PLACE_M = np.array([2.0, 2.5, 1.2])


def standing_crowd(people_m: F64) -> Crowd:
    crowd = make_crowd(len(people_m), PERSON)
    stand(crowd, people_m)
    return crowd


def heard(
    ends: Transducers, people_m: F64, room: Room | None = None, person: Material | None = PERSON
) -> C64:
    """In a room whose surfaces are dead unless told (n, 630), of people (p, 2)."""
    around = room or dead_room()
    out = np.zeros((len(ends.speaker), BAND_BINS), dtype=np.complex64)
    people = np.repeat(people_m[None], len(out), axis=0)
    falling, scene = np.zeros_like(out), scene_of(around)
    add_diffuse(out, falling, scene, scattering_of(around), ends, people, AIR, person=person)
    return out


def energy_of_a_cylinder(speaker_m: F64, microphone_m: F64, person_m: F64) -> float:
    """Lambert's law over the side of a person between the heights that scatter, in small pieces."""
    turn, height = np.linspace(0, 2 * np.pi, 361)[:-1], np.linspace(*SCATTERING_M, 49)
    normal = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)[:, None]
    point = np.append(person_m, 0.0) + PERSON_RADIUS_M * normal + height[:, None] * [0, 0, 1.0]
    area_m2 = 2 * np.pi * PERSON_RADIUS_M * np.ptp(SCATTERING_M) / len(turn) / len(height)
    law = area_m2 * PERSON.diffuse / np.pi * np.ones(point.shape[:2])
    for place in (speaker_m, microphone_m):
        way = place - point
        far = np.linalg.norm(way, axis=-1)
        facing = np.maximum((way * normal).sum(axis=-1) / far, 0.0)
        law *= facing / far**2 * np.exp(-2 * AIR.attenuation_per_m * far)
    return float(law.sum())


# --- where the points are ---


def test_points_lie_on_the_cylinders_and_look_out() -> None:
    people_m = np.array([[1.0, 2.0], [4.0, 3.0]])
    crowd = standing_crowd(people_m)
    away = crowd.point[:, :2] - np.repeat(people_m, POINTS, axis=0)
    np.testing.assert_allclose(away, PERSON_RADIUS_M * crowd.normal[:, :2], atol=1e-12)
    assert np.linalg.norm(crowd.normal, axis=1) == pytest.approx(1.0)
    assert SCATTERING_M[0] <= crowd.point[:, 2].min() < SCATTERING_M[0] + 0.2
    assert SCATTERING_M[1] >= crowd.point[:, 2].max() > SCATTERING_M[1] - 0.2
    turn = np.sort(np.arctan2(crowd.normal[:POINTS, 1], crowd.normal[:POINTS, 0]))
    assert np.diff(turn).max() < 2 * 2 * np.pi / POINTS, "on every side"


def test_a_person_takes_their_points_along() -> None:
    here, there = standing_crowd(np.zeros((3, 2))), standing_crowd(np.full((3, 2), 2.0))
    np.testing.assert_allclose(there.point - here.point, [[2.0, 2.0, 0.0]] * 3 * POINTS)
    first, second = here.point[:POINTS], here.point[POINTS : 2 * POINTS]
    assert np.abs(first - second).max() > 0.05
    alone = standing_crowd(np.zeros((1, 2)))
    assert (alone.point == first).all()
    assert set(np.sign(here.gain)) == {-1.0, 1.0}


# --- what is heard of them ---


def test_a_person_scatters_as_a_cylinder_of_that_cross_section() -> None:
    """On average over where they stand."""
    found, law = [], []
    for turn in np.linspace(0, 2 * np.pi, 40, endpoint=False):
        for distance in (1.5, 1.9):
            person_m = np.array([3.5, 2.5]) + distance * np.array([np.cos(turn), np.sin(turn)])
            speaker_m, microphone_m = np.array([3.5, 2.5, 1.2]), np.array([3.5, 2.4, 1.1])
            out = heard(ends_at(speaker_m, microphone_m), person_m[None])
            found.append(float((np.abs(out) ** 2).sum()))
            law.append(energy_of_a_cylinder(speaker_m, microphone_m, person_m))
    pulse = 0.985  # energy of the pulse of a column, that of one sample being 1
    assert sum(found) == pytest.approx(pulse * sum(law), rel=0.15)


@pytest.mark.parametrize("distance_m", [1.5, 4.0])
def test_a_person_is_heard_after_the_way_to_them_and_back(distance_m: float) -> None:
    out = heard(ends_at(PLACE_M, PLACE_M + 0.1 * X), (PLACE_M + distance_m * X)[None, :2])[0]
    sample = np.arange(BAND_BINS)
    centre = float(np.average(sample, weights=np.abs(out) ** 2))
    nearest_m = 2 * (distance_m - PERSON_RADIUS_M) - 0.1
    assert 0 < centre / BASEBAND_HZ * AIR.speed_mps - nearest_m < 0.6
    assert np.abs(out[: int(nearest_m / AIR.speed_mps * BASEBAND_HZ) - 6]).max() < 1e-9


def test_speaker_and_microphone_may_change_places() -> None:
    """Reciprocity."""
    people_m = np.array([[4.0, 3.5], [1.2, 1.0], [5.5, 1.5]])
    a, b = PLACE_M, PLACE_M + np.array([0.9, 0.4, 0.3])
    forth, back = heard(ends_at(a, b), people_m), heard(ends_at(b, a), people_m)
    assert np.abs(forth).max() > 1e-3
    assert np.abs(forth - back).max() < 1e-5 * np.abs(forth).max()


def test_nothing_is_heard_of_people_behind_a_wall() -> None:
    person_m, ends = (PLACE_M + 3 * X)[None, :2], ends_at(PLACE_M, PLACE_M + 0.1 * X)
    wall = box("wall", [3.5, 0.0, 0.0], [0.1, 5.0, 3.0], DEAD)
    assert heard(ends, person_m).any()
    assert not heard(ends, person_m, dead_room(wall)).any()
    low = box("counter", [3.5, 0.0, 0.0], [0.1, 5.0, 1.1], DEAD)
    over = np.abs(heard(ends, person_m, dead_room(low))) ** 2
    assert 0 < over.sum() < (np.abs(heard(ends, person_m)) ** 2).sum()


def test_people_hide_one_another() -> None:
    ends = ends_at(PLACE_M, PLACE_M + 0.1 * X)
    near, far = (PLACE_M + 1.0 * X)[:2], (PLACE_M + 2.5 * X)[:2]
    both = heard(ends, np.array([near, far]))
    alone = heard(ends, near[None])
    assert np.abs(both - alone).max() < 0.01 * np.abs(alone).max()


def test_nobody_about_or_nobody_of_a_material_changes_no_byte() -> None:
    rough = Material("rough", 0.2, 0.8, "planted")
    room = shoebox(SIZE_M, (rough,) * 6, (), 3)
    somebody, nobody = np.array([[4.0, 3.5]]), np.zeros((0, 2))
    assert (
        heard(ends_at(), nobody, room).tobytes() == heard(ends_at(), nobody, room, None).tobytes()
    )
    scene, scattering = scene_of(room), scattering_of(room)
    plain, silent, scatters = (
        diffuse_echoes(
            scene, ends_at(), somebody[None], AIR, Reach(), scattering=scattering, **kind
        )
        for kind in ({}, {"person": None}, {"person": PERSON})
    )
    assert plain.tobytes() == silent.tobytes() != scatters.tobytes()


def test_threads_and_rows_change_no_byte() -> None:
    """A row does not hear the people of the row before."""
    room, ends = dead_room(), ends_at()
    people_m = np.array([[[4.0, 3.5]], [[1.0, 1.5]], [[5.5, 4.0]]])
    three = Transducers(*(np.repeat(column, 3, axis=0) for column in ends[:7]), *ends[7:10])
    whole = np.zeros((3, BAND_BINS), np.complex64)
    scene, scattering = scene_of(room), scattering_of(room)
    for threads in (1, 3):
        out = np.zeros_like(whole)
        add_diffuse(
            out, np.zeros_like(out), scene, scattering, three, people_m, AIR, threads, PERSON
        )
        for k in range(3):
            assert out[k].tobytes() == heard(ends, people_m[k])[0].tobytes()
