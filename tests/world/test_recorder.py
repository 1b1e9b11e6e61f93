"""The stream of a recording: where every chirp stands in it, and what each circumstance adds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world import recorder
from elfslam.world.circumstances import SOUNDS, Circumstances
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, Device, built_in_device
from elfslam.world.materials import material
from elfslam.world.phone import air_at
from elfslam.world.pulses import C64
from elfslam.world.room import box, shoebox
from elfslam.world.transducers import GainControl, controlled
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion, Walker, random_walker
from elfslam.world.world_file import World

FLAT = replace(built_in_device("flat"), noise_rms=0.0)
PLACE_M = np.array([2.5, 2.0, 1.2])
SEED = 11


def closet(*blocks: object) -> World:
    """A muffled room of 6 by 5 m, so that the direct sound stands out."""
    felt = (replace(material("plaster"), absorption=0.99),) * 6
    room = shoebox(np.array([6.0, 5.0, 2.6]), felt, blocks, seed=3)
    return World("closet", room, np.array([[1.0, 1.0], [5.0, 1.0], [5.0, 4.0], [1.0, 4.0]]))


def standing(duration_s: float) -> Motion:
    """Somebody who stands still and looks along x."""
    count = round(duration_s * KINEMATICS_RATE_HZ) + 1
    still = np.zeros(count)
    t_s = np.arange(count) / KINEMATICS_RATE_HZ
    return Motion(t_s, np.tile(PLACE_M, (count, 1)), still, still + 0.4, still, still, still)


def walker() -> Walker:
    return random_walker(np.random.default_rng(0))


def recorded(
    circumstances: Circumstances | None = None,
    *,
    duration_s: float = 3.0,
    rate_hz: int = 44_100,
    seed: int = SEED,
    world: World | None = None,
    motion: Motion | None = None,
) -> F32:
    heard, *_ = recorder.record_walk(
        world or closet(), circumstances or Circumstances(device="flat"), walker(),
        motion or standing(duration_s), rate_hz, seed, np.random.default_rng(seed),
        lambda share: None,
    )  # fmt: skip
    assert heard.rate_hz == rate_hz
    return np.asarray(heard.samples[0])


def use(monkeypatch: pytest.MonkeyPatch, device: Device) -> None:
    monkeypatch.setattr(recorder, "device_of", lambda circumstances: device)


def latency_of(rate_hz: int, seed: int = SEED) -> int:
    return round(np.random.default_rng(seed).uniform(*recorder.LATENCY_S) * rate_hz)


def arrivals(stream: F32, rate_hz: int, first: float, period: float, count: int) -> F64:
    """Where chirps stand, to a tenth of a sample, each within a millisecond of where it should."""
    chirp = make_chirp(ChirpParameters(), rate_hz).samples.astype(np.float64)
    found, near, fine = [], round(1e-3 * rate_hz), 32
    for k in range(count):
        start = round(first + k * period) - near
        piece = stream[start : start + len(chirp) + 2 * near].astype(np.float64)
        match = signal.correlate(piece, chirp, mode="valid")
        match = signal.resample(match, fine * len(match))
        found.append(start + np.argmax(match) / fine)
    return np.array(found)


@pytest.mark.parametrize("rate_hz", [44_100, 48_000])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_direct_sound_stands_where_it_must(rate_hz: int, seed: int) -> None:
    """A latency of this run, a frame of 100 ms for each, and the way from speaker to microphone."""
    stream = recorded(rate_hz=rate_hz, seed=seed)
    frame, way_s = rate_hz / 10, FLAT.separation_m / air_at().speed_mps
    expected = latency_of(rate_hz, seed) + way_s * rate_hz + frame * np.arange(28)
    assert len(stream) == 3 * rate_hz
    assert arrivals(stream, rate_hz, expected[0], frame, 28) == pytest.approx(expected, abs=0.3)
    assert not (np.abs(stream[: latency_of(rate_hz, seed)]) > 2e-3).any()


def test_jitter_moves_every_chirp_by_the_jitter(monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, FLAT)
    steady = recorded()
    use(monkeypatch, replace(FLAT, jitter_s=1e-4))
    shaken = recorded()
    planted = 1e-4 * np.random.default_rng([SEED, 6]).standard_normal(29)[:28] * 44_100
    first = latency_of(44_100) + 19.3
    moved = arrivals(shaken, 44_100, first, 4410, 28) - arrivals(steady, 44_100, first, 4410, 28)
    assert moved == pytest.approx(planted, abs=0.1)
    assert moved.std() == pytest.approx(4.41, rel=0.3)


@pytest.mark.parametrize("skew_ppm", [1000.0, -1000.0])
def test_skew_stretches_the_stream(monkeypatch: pytest.MonkeyPatch, skew_ppm: float) -> None:
    use(monkeypatch, replace(FLAT, clock_skew_ppm=skew_ppm))
    stream = recorded()
    stretch = 1 + skew_ppm * 1e-6
    first = (latency_of(44_100) + 19.3) * stretch
    found = arrivals(stream, 44_100, first, 4410 * stretch, 28)
    assert np.polyfit(np.arange(28), found, 1)[0] == pytest.approx(4410 * stretch, abs=0.02)
    assert len(stream) == 3 * 44_100


def test_a_walk_in_one_world_is_cut_anywhere() -> None:
    """Two visits of it are recorded as one; in another world something else is heard."""
    alone = Circumstances(device="flat")
    visits = [recorder.WorldVisit(t_s, closet(), alone) for t_s in (0.0, 1.234)]
    other = replace(closet(), room=replace(closet().room, height_m=closet().room.height_m + 1.0))
    elsewhere = [visits[0], visits[1]._replace(world=other)]
    cut, moved = (
        recorder.record_visits(
            each, walker(), standing(3.0), 44_100, SEED, np.random.default_rng(SEED), lambda _: None
        )[0].samples[0]
        for each in (visits, elsewhere)
    )
    whole = recorded()
    assert cut.tobytes() == whole.tobytes()
    assert moved[: round(1.2 * 44_100)].tobytes() == whole[: round(1.2 * 44_100)].tobytes()
    assert np.abs(moved - whole)[round(1.4 * 44_100) :].max() > 1e-4


def test_a_covered_port_takes_from_direct_sound_and_echoes(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the second on in which it is covered; what others play is as loud as before."""
    use(monkeypatch, FLAT)
    motion = standing(3.0)
    late = np.where(motion.t_s > 1.5, 12.0, 0.0)
    asked = Circumstances(sounds=("clicks",))
    plain = recorded()
    opened, closed = (recorded(asked, motion=replace(motion, covered_db=db)) for db in (None, late))
    sounds = opened - plain
    band = signal.butter(6, (15_500, 19_500), "bandpass", fs=44_100, output="sos")
    chirped = ((stream - sounds).astype(float) for stream in (opened, closed))
    loud, soft = (signal.sosfiltfilt(band, stream) for stream in chirped)
    for part in (slice(50, 460), slice(700, 2000)):  # the direct chirp, and echoes alone
        starts = range(latency_of(44_100), 27 * 4410, 4410)
        levels = [[np.linalg.norm(stream[k:][part]) for k in starts] for stream in (loud, soft)]
        taken_db = 20 * np.log10(np.divide(*levels))
        assert taken_db[:13] == pytest.approx(0.0, abs=0.01)
        assert taken_db[15:] == pytest.approx(12.0, abs=1.5)


def other_phone(world: World, seed: int, k: int) -> tuple[F64, int, float]:
    """Place, offset in samples and relative period of the k-th other phone."""
    generator = np.random.default_rng([seed, 5, k])
    place = recorder._standing_place(world, generator)
    offset, ppm = generator.integers(4410), generator.normal(0, recorder.OTHER_CLOCK_PPM)
    return place, int(offset), 1 + ppm * 1e-6


@pytest.mark.parametrize("seed", [3, 4])
def test_another_phone_is_heard_by_its_clock(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    use(monkeypatch, FLAT)
    asked = Circumstances(other_phones=1)
    alone, both = (recorded(each, duration_s=12.0, seed=seed) for each in (Circumstances(), asked))
    place, offset, period = other_phone(closet(), seed, 0)
    microphone = PLACE_M - 0.075 * np.array([np.cos(0.4), 0.0, np.sin(0.4)])
    way_m = np.linalg.norm(np.append(place, recorder.OTHER_HEIGHT_M) - microphone)
    first = latency_of(44_100, seed) + offset + way_m / air_at().speed_mps * 44_100
    found = arrivals(both - alone, 44_100, first, 4410 * period, 110)
    assert found[0] == pytest.approx(first, abs=1.0)
    slope = np.polyfit(np.arange(110), found, 1)[0]
    assert slope == pytest.approx(4410 * period, abs=0.01)
    assert abs(slope - 4410) > 0.01, "a clock of its own"


def test_phones_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, FLAT)
    none, one, two = (recorded(Circumstances(other_phones=count)) for count in range(3))
    assert np.abs(one - none).max() > 1e-4
    assert np.abs(two - one).max() > 1e-4
    places = [other_phone(closet(), SEED, k) for k in range(2)]
    assert places[0][1] != places[1][1]
    assert np.linalg.norm(places[0][0] - places[1][0]) > 0.1


def test_a_full_room_has_no_place_for_another_phone() -> None:
    world = closet(box("crate", np.array([0.0, 0.0, 0.0]), np.array([6.0, 5.0, 2.0])))
    with pytest.raises(InputError, match="'closet': no free place for another phone; leave it out"):
        recorded(Circumstances(other_phones=1), world=world)


@pytest.mark.parametrize("names", [("music",), ("clicks", "speech")])
def test_sounds_come_on_top(monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...]) -> None:
    use(monkeypatch, FLAT)
    added = recorded(Circumstances(sounds=names)) - recorded()
    expected = np.zeros(len(added))
    for k, (name, sound) in enumerate(SOUNDS.items()):
        if name in names:
            made = sound(len(added), 44_100, np.random.default_rng([SEED, 7, k]))
            expected += made
            if name != "clicks":
                assert np.sqrt(np.mean(made.astype(float) ** 2)) == pytest.approx(0.02, rel=1e-4)
    assert added == pytest.approx(expected, abs=1e-7)


def test_the_volume_scales_the_chirps_and_leaves_the_noise() -> None:
    """Noise and rumble are the same, so that differences are of chirps alone."""
    streams = [recorded(Circumstances(volume=volume)) for volume in (1.0, 0.75, 0.5)]
    upper, lower = streams[0] - streams[1], streams[1] - streams[2]
    assert np.abs(upper).max() > 1e-3
    assert upper == pytest.approx(lower, abs=1e-7)
    assert streams[0] == pytest.approx(streams[2] + upper + lower, abs=1e-7)
    before = slice(0, latency_of(44_100))
    assert (streams[0][before] == streams[2][before]).all()


def test_people_and_state_change_the_echoes_and_not_the_direct_sound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    use(monkeypatch, FLAT)
    alone, met = recorded(), recorded(Circumstances(people=6))
    changed = (met - alone)[latency_of(44_100) :][: 25 * 4410].reshape(25, 4410)
    arrival = round(FLAT.separation_m / 343.2 * 44_100)
    assert np.abs(changed[:, arrival : arrival + 30]).max() < 0.02 * np.abs(alone).max()
    assert np.abs(changed).max() > 1e-5


def test_what_is_too_loud_is_clipped(monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, FLAT)
    full = recorded()
    use(monkeypatch, replace(FLAT, clip_level=0.02))
    clipped = recorded()
    assert np.abs(full).max() > 0.05
    np.testing.assert_array_equal(clipped, np.clip(full, -0.02, 0.02).astype(np.float32))


def test_gain_control_comes_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the noise, and within full scale."""
    phone = replace(built_in_device("cheap"), clip_level=0.5)
    use(monkeypatch, phone)
    plain = recorded()
    control = GainControl(attack_s=0.02, release_s=0.05, target_level=0.3)
    use(monkeypatch, replace(phone, gain_control=control))
    ridden = recorded()
    assert ridden.tobytes() == controlled(plain, control, 44_100, 0.5).tobytes()
    assert np.abs(plain).max() < 0.4
    assert np.abs(ridden).max() == 0.5
    before = slice(0, latency_of(44_100))
    assert ridden[before].std() > 1.2 * plain[before].std()


def some_envelopes(count: int) -> C64:
    parts = np.random.default_rng(0).standard_normal((2, count, BAND_BINS))
    return (parts[0] + 1j * parts[1]).astype(np.complex64)


def loss_db(before: C64, after: C64, frequency_hz: float) -> F64:
    at = round((frequency_hz - BAND_LOW_HZ) / BIN_HZ)
    spectra = [np.fft.fftshift(np.fft.fft(rows, axis=1), axes=1)[:, at] for rows in (before, after)]
    return np.asarray(20 * np.log10(np.abs(spectra[0] / spectra[1])))


@pytest.mark.parametrize(("frequency_hz", "share"), [(15e3, 0.7), (17.5e3, 1.0), (20e3, 1.3)])
def test_a_cover_takes_its_decibels_and_more_on_top(frequency_hz: float, share: float) -> None:
    sound, covered_db = some_envelopes(3), np.array([6.0, 0.0, 20.0])
    taken = loss_db(sound, recorder.port_occlusion(sound, covered_db), frequency_hz)
    assert taken == pytest.approx(share * covered_db, abs=1e-3)


def test_what_is_open_keeps_every_byte() -> None:
    sound = some_envelopes(3)
    assert recorder.port_occlusion(sound, np.zeros(3)) is sound
    half = recorder.port_occlusion(sound, np.array([0.0, 9.0, 0.0]))
    assert half[[0, 2]].tobytes() == sound[[0, 2]].tobytes()
    assert half.dtype == np.complex64
    assert np.abs(half[1] - sound[1]).max() > 0.1


def test_a_cover_delays_nothing() -> None:
    """An impulse stays where it is."""
    impulse = np.zeros((1, BAND_BINS), np.complex64)
    impulse[0, 100] = 1.0
    heard = np.abs(recorder.port_occlusion(impulse, np.full(1, 20.0))[0])
    assert heard.argmax() == 100
    assert heard[100] == pytest.approx(0.1, rel=0.2)
    assert np.delete(heard, range(97, 104)).max() < 0.1 * heard[100]
