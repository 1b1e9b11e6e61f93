"""The diffuse field at a phone: planted chains come, both ways alike, and move as paths do."""

from dataclasses import replace

import numpy as np
import pytest
from one_phone import AIR, DEAD, MICROPHONE_M, SIZE_M, SPEAKER_M, X, dead_room, ends_at

from elfslam.base.arrays import F64
from elfslam.world import diffuse
from elfslam.world.device import BAND_BINS
from elfslam.world.materials import Material, material
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers, image_echoes
from elfslam.world.plan import PERSON_RADIUS_M
from elfslam.world.pulses import BASEBAND_HZ, C64, CARRIER_HZ
from elfslam.world.room import Room, box, shoebox
from elfslam.world.scattering import Chains, Scattering, scattering_of
from elfslam.world.scene import scene_of

ROUGH = Material("rough", 0.2, 0.8, "planted")
PERSON = Material("person", 0.0, 0.5, "planted")
FALL = 1.7
NOBODY = np.zeros((1, 0, 2))


def rough_room(seed: int = 3) -> Room:
    return shoebox(SIZE_M, (ROUGH,) * 6, (), seed)


def heard(
    scattering: Scattering, ends: Transducers, room: Room | None = None, people_m: F64 = NOBODY
) -> C64:
    return heard_and_falling(scattering, ends, room, people_m)[0]


def heard_and_falling(
    scattering: Scattering, ends: Transducers, room: Room | None = None, people_m: F64 = NOBODY,
    person: Material | None = None,
) -> C64:  # fmt: skip
    """Envelopes (2, n, 630): what is heard, and the same with each path times its fall."""
    out, falling = both = np.zeros((2, len(ends.speaker), BAND_BINS), dtype=np.complex64)
    scene = scene_of(room or rough_room())
    diffuse.add_diffuse(out, falling, scene, scattering, ends, people_m, AIR, 1, person)
    return both


def one_chain(scattering: Scattering, first: int, last: int, length_m: float) -> Scattering:
    """Of all that is scattered, one chain alone."""
    count = len(scattering.once)
    start = (np.arange(count + 1) > first).astype(np.int64)
    length, one, fall = np.array([length_m]), np.ones(1), np.array([FALL])
    chain = Chains(start, np.array([last], dtype=np.int32), length, one, fall)
    return Scattering(scattering.patches, np.zeros(count), chain)


def facing(scattering: Scattering, k: int, place: F64) -> tuple[float, float]:
    """Distance of a patch from a place and the cosine at the patch."""
    way = place - scattering.patches.point[k]
    far = float(np.linalg.norm(way))
    return far, float(way @ scattering.patches.normal[k]) / far


@pytest.mark.parametrize(("first", "last"), [(0, 30), (12, 12), (50, 3)])
def test_a_chain_is_heard_after_its_way_and_at_its_gain(first: int, last: int) -> None:
    whole = scattering_of(rough_room())
    out = heard(one_chain(whole, first, last, 2.5), ends_at())[0]
    (there, cos_there), (home, cos_home) = (
        facing(whole, first, SPEAKER_M), facing(whole, last, MICROPHONE_M),
    )  # fmt: skip
    length = there + 2.5 + home
    delay_s = length / AIR.speed_mps
    gain = np.sqrt(cos_there * cos_home) / there / home * np.exp(-AIR.attenuation_per_m * length)
    peak = np.abs(out).argmax()
    assert peak == pytest.approx(delay_s * BASEBAND_HZ, abs=0.6)
    carrier = out.sum() / np.exp(-2j * np.pi * CARRIER_HZ * delay_s)
    assert abs(carrier) == pytest.approx(gain, rel=0.02)
    assert abs(np.angle(carrier)) < 0.05


def test_lobes_are_those_of_the_mirror_images() -> None:
    """A chain's gain is its first direction's at the speaker times its last one's at the ear."""
    chain = one_chain(scattering_of(rough_room()), 0, 30, 2.5)
    across = np.array([0.3, 1.4, -0.5])
    ends = ends_at()._replace(
        speaker_across=across[None], microphone_across=-0.6 * across[None],
        speaker_lobe_share=0.3, microphone_lobe_share=0.2,
    )  # fmt: skip
    away = [chain.patches.point[0] - SPEAKER_M, chain.patches.point[30] - MICROPHONE_M]
    turns = [part @ across / np.linalg.norm(part) for part in away]
    law = (0.7 + 0.3 * np.cos(2 * np.pi * turns[0])) * (0.8 + 0.2 * np.cos(1.2 * np.pi * turns[1]))
    assert 0.2 < law < 0.9
    plain, lobed = heard(chain, ends_at()), heard(chain, ends)
    assert np.abs(lobed - law * plain).max() < 1e-5 * np.abs(plain).max()
    none = ends._replace(speaker_lobe_share=0.0, microphone_lobe_share=0.0)
    assert heard(chain, none).tobytes() == plain.tobytes()


def test_a_patch_alone_is_heard_as_loud_as_it_scatters() -> None:
    """Its glints add up as energies: on average over patches they are the law's."""
    whole = scattering_of(rough_room())
    none = whole.chains._replace(
        start=np.zeros(len(whole.once) + 1, dtype=np.int64), to=whole.chains.to[:0],
        length=whole.chains.length[:0], gain=whole.chains.gain[:0], fall=whole.chains.fall[:0],
    )  # fmt: skip
    found, law = [], []
    for k in range(len(whole.once)):
        once = np.where(np.arange(len(whole.once)) == k, whole.once, 0.0)
        out = heard(Scattering(whole.patches, once, none), ends_at())[0]
        (there, a), (home, b) = facing(whole, k, SPEAKER_M), facing(whole, k, MICROPHONE_M)
        found.append(float((np.abs(out) ** 2).sum()))
        damped = np.exp(-2 * AIR.attenuation_per_m * (there + home))
        law.append(whole.once[k] ** 2 * max(a, 0) * max(b, 0) / (there * home) ** 2 * damped)
    pulse = 0.985  # energy of the pulse of a column, that of one sample being 1
    assert diffuse.GLINTS > 1
    assert sum(found) == pytest.approx(pulse * sum(law), rel=0.2)


def test_a_phone_that_moves_hears_its_echoes_stretched() -> None:
    """By the velocity as by the places it comes to: the phase of a chain turns with its length."""
    whole = one_chain(scattering_of(rough_room()), 0, 30, 2.0)
    velocity = np.array([0.9, -0.4, 0.0])
    still, moving = heard(whole, ends_at())[0], heard(whole, ends_at(velocity_mps=velocity))[0]
    into_chirp_s = 0.0054  # when the chirp passes the carrier
    later = ends_at(SPEAKER_M + into_chirp_s * velocity, MICROPHONE_M + into_chirp_s * velocity)
    there = heard(whole, later)[0]
    turned = np.angle(moving.sum() / still.sum())
    assert turned == pytest.approx(np.angle(there.sum() / still.sum()), abs=0.1)


def test_a_person_hides_patches() -> None:
    scattering = scattering_of(rough_room())
    ends = ends_at(SPEAKER_M, SPEAKER_M + 0.1 * X)
    alone = heard(scattering, ends)
    beside = heard(scattering, ends, people_m=(SPEAKER_M + 0.6 * X)[None, None, :2])
    loss = 1 - (np.abs(beside) ** 2).sum() / (np.abs(alone) ** 2).sum()
    assert 0.02 < loss < 0.6


def test_every_path_is_also_written_times_its_fall() -> None:
    """A chain's, a patch's and a person's; twice the carrier's phase changes nothing of it."""
    whole = scattering_of(rough_room())
    for ends in (ends_at(), ends_at(velocity_mps=np.array([0.9, -0.4, 0.2]))):
        out, falling = heard_and_falling(one_chain(whole, 0, 30, 2.5), ends)
        assert np.abs(out).max() > 0
        assert np.abs(falling - FALL * out).max() < 1e-5 * np.abs(out).max()
    none, count = one_chain(whole, 0, 30, 2.5), len(whole.once)
    seen = [max(facing(whole, k, SPEAKER_M)[1], 0) for k in range(count)]
    k = int(np.argmax(whole.once**2 * seen))
    alone = none._replace(
        once=np.where(np.arange(count) == k, whole.once, 0.0),
        chains=none.chains._replace(gain=np.zeros(1)),
    )
    out, falling = heard_and_falling(alone, ends_at())
    assert np.abs(out).max() > 0
    assert np.abs(falling - whole.patches.diffuse_fall[k] * out).max() < 1e-5 * np.abs(out).max()
    beside = (SPEAKER_M + 1.2 * X)[None, None, :2]
    nothing = alone._replace(once=np.zeros(len(whole.once)))
    out, falling = heard_and_falling(nothing, ends_at(), None, beside, PERSON)
    assert np.abs(out).max() > 0
    assert np.abs(falling - PERSON.diffuse_fall * out).max() < 1e-5 * np.abs(out).max()


def test_the_whole_engine_is_reciprocal_at_every_frequency() -> None:
    room = rough_room()
    scene, scattering = scene_of(room), scattering_of(room)
    forth, back = (
        diffuse.diffuse_echoes(scene, ends, NOBODY, AIR, Reach(), scattering=scattering)[0]
        for ends in (ends_at(), ends_at(MICROPHONE_M, SPEAKER_M))
    )
    spectra = np.fft.fft(forth), np.fft.fft(back)
    assert np.abs(spectra[0] - spectra[1]).max() < 1e-5 * np.abs(spectra[0]).max()


def spectrum_of(envelope: C64) -> tuple[F64, F64]:
    """Frequencies from the carrier between 15 and 20 kHz, and the level there (dB)."""
    hz = np.fft.fftfreq(BAND_BINS, 1 / BASEBAND_HZ)
    inside = np.abs(hz) <= 2_500.0
    return hz[inside], 20 * np.log10(np.abs(np.fft.fft(envelope))[inside])


@pytest.mark.parametrize("scattering", [0.05, 0.21, 0.45])
def test_a_wall_mirrors_everywhere_what_it_keeps_and_scatters_not(scattering: float) -> None:
    """Oracle: the one wall that is not dead, by what the material says of each frequency."""
    wall = Material("wall", 0.2, scattering, "planted")
    room = shoebox(SIZE_M, (wall,) + (DEAD,) * 5, (), 3)
    rough = scattering_of(room)
    silent = rough._replace(once=np.zeros_like(rough.once))
    silent = silent._replace(chains=silent.chains._replace(gain=np.zeros(len(silent.chains.to))))
    flat = AIR._replace(tilt_per_m_hz=0.0)
    reach, bare = Reach(order=1, plan_order=1), shoebox(SIZE_M, (DEAD,) * 6, (), 3)
    direct = image_echoes(scene_of(bare), ends_at(), NOBODY, flat, reach)[0]
    smooth = shoebox(SIZE_M, (replace(wall, scattering=0.0),) + (DEAD,) * 5, (), 3)
    mirror = image_echoes(scene_of(smooth), ends_at(), NOBODY, flat, reach)[0]
    mirrored = np.sqrt(1 - scattering) * (mirror - direct)
    given = scene_of(room), ends_at(), NOBODY, flat, reach
    found = diffuse.diffuse_echoes(*given, scattering=silent)[0]
    found -= direct
    hz, level_db = spectrum_of(found)
    other_db = spectrum_of(mirrored)[1]
    law_db = 20 * np.log10([wall.at(CARRIER_HZ + f).reflection / wall.reflection for f in hz])
    assert np.abs(level_db - other_db - law_db).max() < 0.05


def test_air_damps_the_upper_edge_more_than_the_lower() -> None:
    """4 dB between 15 and 20 kHz after 21 m (ISO 9613-1 at 20 degrees and 50 %)."""
    pulse = np.zeros((1, BAND_BINS), dtype=np.complex64)
    metres = 20.0
    pulse[0, round(metres / AIR.speed_mps * BASEBAND_HZ)] = 1.0
    heard_through = diffuse.tilted(pulse, np.zeros_like(pulse), AIR)
    transfer = 20 * np.log10(np.abs(np.fft.fftshift(np.fft.fft(heard_through[0]))))
    low, middle, high = transfer[[65, 315, 565]]
    assert low - high == pytest.approx(4.0 * metres / 21.0, abs=0.4)
    assert middle == pytest.approx(0.0, abs=0.01)


CROWD_PERSON = material("person")
PLACE_M = np.array([2.0, 2.5, 1.2])


def standing_crowd(people_m: F64) -> diffuse.Crowd:
    crowd = diffuse.make_crowd(len(people_m), CROWD_PERSON)
    diffuse.stand(crowd, people_m)
    return crowd


def heard_crowd(
    ends: Transducers,
    people_m: F64,
    room: Room | None = None,
    person: Material | None = CROWD_PERSON,
) -> C64:
    """In a room whose surfaces are dead unless told (n, 630), of people (p, 2)."""
    around = room or dead_room()
    out = np.zeros((len(ends.speaker), BAND_BINS), dtype=np.complex64)
    people = np.repeat(people_m[None], len(out), axis=0)
    falling, scene = np.zeros_like(out), scene_of(around)
    diffuse.add_diffuse(
        out, falling, scene, scattering_of(around), ends, people, AIR, person=person
    )
    return out


def energy_of_a_cylinder(speaker_m: F64, microphone_m: F64, person_m: F64) -> float:
    """Lambert's law over the side of a person between the heights that scatter, in small pieces."""
    turn, height = np.linspace(0, 2 * np.pi, 361)[:-1], np.linspace(*diffuse.SCATTERING_M, 49)
    normal = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)[:, None]
    point = np.append(person_m, 0.0) + PERSON_RADIUS_M * normal + height[:, None] * [0, 0, 1.0]
    area_m2 = 2 * np.pi * PERSON_RADIUS_M * np.ptp(diffuse.SCATTERING_M) / len(turn) / len(height)
    law = area_m2 * CROWD_PERSON.diffuse / np.pi * np.ones(point.shape[:2])
    for place in (speaker_m, microphone_m):
        way = place - point
        far = np.linalg.norm(way, axis=-1)
        facing = np.maximum((way * normal).sum(axis=-1) / far, 0.0)
        law *= facing / far**2 * np.exp(-2 * AIR.attenuation_per_m * far)
    return float(law.sum())


def test_points_lie_on_the_cylinders_and_look_out() -> None:
    people_m = np.array([[1.0, 2.0], [4.0, 3.0]])
    crowd = standing_crowd(people_m)
    away = crowd.point[:, :2] - np.repeat(people_m, diffuse.POINTS, axis=0)
    np.testing.assert_allclose(away, PERSON_RADIUS_M * crowd.normal[:, :2], atol=1e-12)
    assert np.linalg.norm(crowd.normal, axis=1) == pytest.approx(1.0)
    assert diffuse.SCATTERING_M[0] <= crowd.point[:, 2].min() < diffuse.SCATTERING_M[0] + 0.2
    assert diffuse.SCATTERING_M[1] >= crowd.point[:, 2].max() > diffuse.SCATTERING_M[1] - 0.2
    turn = np.sort(np.arctan2(crowd.normal[: diffuse.POINTS, 1], crowd.normal[: diffuse.POINTS, 0]))
    assert np.diff(turn).max() < 2 * 2 * np.pi / diffuse.POINTS, "on every side"


def test_a_person_takes_their_points_along() -> None:
    here, there = standing_crowd(np.zeros((3, 2))), standing_crowd(np.full((3, 2), 2.0))
    np.testing.assert_allclose(there.point - here.point, [[2.0, 2.0, 0.0]] * 3 * diffuse.POINTS)
    first, second = here.point[: diffuse.POINTS], here.point[diffuse.POINTS : 2 * diffuse.POINTS]
    assert np.abs(first - second).max() > 0.05
    alone = standing_crowd(np.zeros((1, 2)))
    assert (alone.point == first).all()
    assert set(np.sign(here.gain)) == {-1.0, 1.0}


def test_a_person_scatters_as_a_cylinder_of_that_cross_section() -> None:
    """On average over where they stand."""
    found, law = [], []
    for turn in np.linspace(0, 2 * np.pi, 40, endpoint=False):
        for distance in (1.5, 1.9):
            person_m = np.array([3.5, 2.5]) + distance * np.array([np.cos(turn), np.sin(turn)])
            speaker_m, microphone_m = np.array([3.5, 2.5, 1.2]), np.array([3.5, 2.4, 1.1])
            out = heard_crowd(ends_at(speaker_m, microphone_m), person_m[None])
            found.append(float((np.abs(out) ** 2).sum()))
            law.append(energy_of_a_cylinder(speaker_m, microphone_m, person_m))
    pulse = 0.985  # energy of the pulse of a column, that of one sample being 1
    assert sum(found) == pytest.approx(pulse * sum(law), rel=0.15)


@pytest.mark.parametrize("distance_m", [1.5, 4.0])
def test_a_person_is_heard_after_the_way_to_them_and_back(distance_m: float) -> None:
    out = heard_crowd(ends_at(PLACE_M, PLACE_M + 0.1 * X), (PLACE_M + distance_m * X)[None, :2])[0]
    sample = np.arange(BAND_BINS)
    centre = float(np.average(sample, weights=np.abs(out) ** 2))
    nearest_m = 2 * (distance_m - PERSON_RADIUS_M) - 0.1
    assert 0 < centre / BASEBAND_HZ * AIR.speed_mps - nearest_m < 0.6
    assert np.abs(out[: int(nearest_m / AIR.speed_mps * BASEBAND_HZ) - 6]).max() < 1e-9


def test_speaker_and_microphone_may_change_places_of_crowd() -> None:
    """Reciprocity."""
    people_m = np.array([[4.0, 3.5], [1.2, 1.0], [5.5, 1.5]])
    a, b = PLACE_M, PLACE_M + np.array([0.9, 0.4, 0.3])
    forth, back = heard_crowd(ends_at(a, b), people_m), heard_crowd(ends_at(b, a), people_m)
    assert np.abs(forth).max() > 1e-3
    assert np.abs(forth - back).max() < 1e-5 * np.abs(forth).max()


def test_nothing_is_heard_of_people_behind_a_wall() -> None:
    person_m, ends = (PLACE_M + 3 * X)[None, :2], ends_at(PLACE_M, PLACE_M + 0.1 * X)
    wall = box("wall", [3.5, 0.0, 0.0], [0.1, 5.0, 3.0], DEAD)
    assert heard_crowd(ends, person_m).any()
    assert not heard_crowd(ends, person_m, dead_room(wall)).any()
    low = box("counter", [3.5, 0.0, 0.0], [0.1, 5.0, 1.1], DEAD)
    over = np.abs(heard_crowd(ends, person_m, dead_room(low))) ** 2
    assert 0 < over.sum() < (np.abs(heard_crowd(ends, person_m)) ** 2).sum()


def test_threads_and_rows_change_no_byte() -> None:
    """A row does not hear the people of the row before."""
    room, ends = dead_room(), ends_at()
    people_m = np.array([[[4.0, 3.5]], [[1.0, 1.5]], [[5.5, 4.0]]])
    three = Transducers(*(np.repeat(column, 3, axis=0) for column in ends[:7]), *ends[7:10])
    whole = np.zeros((3, BAND_BINS), np.complex64)
    scene, scattering = scene_of(room), scattering_of(room)
    for threads in (1, 3):
        out = np.zeros_like(whole)
        diffuse.add_diffuse(
            out, np.zeros_like(out), scene, scattering, three, people_m, AIR, threads, CROWD_PERSON
        )
        for k in range(3):
            assert out[k].tobytes() == heard_crowd(ends, people_m[k])[0].tobytes()
