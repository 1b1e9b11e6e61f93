"""Echo synthesis against an independent engine, a naive sum over paths, and laws of acoustics."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pyroomacoustics
import pytest
from scipy import signal

from elfslam.base.arrays import F64
from elfslam.base.values import Chirp
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.line.echo import matched_envelope
from elfslam.world.acoustics import (
    BASEBAND_HZ,
    BODY_REFLECTION,
    BODY_SHADOW,
    CARRIER_HZ,
    LONGEST_PATH_M,
    MOST_IMAGES,
    Images,
    image_sources,
    phone_geometry,
    render_frames,
    room_responses,
)
from elfslam.world.air import SPEED_OF_SOUND_MPS, absorption_db_per_m
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, Device, named_device
from elfslam.world.room import Room

C64 = npt.NDArray[np.complex64]
RATE_HZ = 44_100
SIZE_M = np.array([7.0, 5.0, 3.0])
REFLECTION = np.array([0.7, 0.6, 0.65, 0.75, 0.5, 0.8])
WALLS = ("west", "east", "south", "north", "floor", "ceiling")
AIR_DB_PER_M = absorption_db_per_m(CARRIER_HZ)
PLACE_M = np.array([2.3, 1.9, 1.2])
UPRIGHT_RAD = np.pi / 2
"""A phone that points straight up has no side behind it: the holder's body shadows nothing."""
PLAIN = Device(
    name="plain",
    response=np.ones(BAND_BINS),
    speaker_directivity=0.0,
    microphone_directivity=0.0,
    level=1.0,
)


def room_of(
    reflection: F64, points_m: F64 | None = None, radius_m: float = 0.1, size_m: F64 = SIZE_M
) -> Room:
    points = np.zeros((0, 3)) if points_m is None else np.atleast_2d(points_m)
    return Room(size_m, reflection, points, np.full(len(points), radius_m))


def beside(x_m: float, y_m: float, z_m: float) -> F64:
    return PLACE_M + np.array([x_m, y_m, z_m])


def anechoic(*points_m: F64, size_m: F64 = SIZE_M) -> Room:
    return room_of(np.zeros(6), np.array(points_m).reshape(-1, 3), size_m=size_m)


def chirp_at(rate_hz: int = RATE_HZ) -> Chirp:
    return make_chirp(ChirpParameters(), rate_hz)


def responses_at(
    room: Room,
    *,
    place_m: F64 = PLACE_M,
    yaw_rad: float = 0.0,
    pitch_rad: float = UPRIGHT_RAD,
    device: Device = PLAIN,
) -> C64:
    """The response (1, 630) at one place, the near field (direct sound and body) included."""
    return room_responses(
        room,
        image_sources(room),
        device,
        np.atleast_2d(place_m),
        np.array([yaw_rad]),
        np.array([pitch_rad]),
        np.array([0.35]),
    )


def echoes_at(
    room: Room,
    *,
    place_m: F64 = PLACE_M,
    yaw_rad: float = 0.0,
    pitch_rad: float = UPRIGHT_RAD,
    device: Device = PLAIN,
) -> C64:
    """The response without the near field, which is that of a room where nothing reflects."""
    whole = responses_at(room, place_m=place_m, yaw_rad=yaw_rad, pitch_rad=pitch_rad, device=device)
    return whole - responses_at(anechoic(), place_m=place_m, device=device)


def spectrum_of(responses: C64) -> C64:
    """Transfer functions (n, 630) over the band, 10 Hz apart from 14.35 kHz on."""
    return np.fft.fftshift(np.fft.fft(responses, axis=1), axes=1).astype(np.complex64)


def sound_of(responses: C64, rate_hz: int = RATE_HZ) -> F64:
    return render_frames(responses, chirp_at(rate_hz), PLAIN)[0].astype(np.float64)


def bin_of(frequency_hz: float) -> int:
    return round((frequency_hz - BAND_LOW_HZ) / BIN_HZ)


# --- an independent engine ---


def shoebox(max_order: int) -> pyroomacoustics.ShoeBox:
    """The same empty room in pyroomacoustics, with the image sources of an upright phone."""
    materials = {
        wall: pyroomacoustics.Material(energy_absorption=1 - r**2)
        for wall, r in zip(WALLS, REFLECTION, strict=True)
    }
    box = pyroomacoustics.ShoeBox(
        SIZE_M, fs=RATE_HZ, materials=materials, max_order=max_order, air_absorption=False
    )
    speaker, microphone, _ = phone_geometry(
        PLACE_M[None], np.zeros(1), np.array([UPRIGHT_RAD]), PLAIN.separation_m
    )
    box.add_source(speaker[0])
    box.add_microphone(microphone[0])
    return box


def sound_by_pyroomacoustics() -> F64:
    """The chirp (4410) as pyroomacoustics renders it, cut to the band, without direct sound."""
    box = shoebox(max_order=17)
    box.compute_rir()
    half_filter = pyroomacoustics.constants.get("frac_delay_length") // 2
    response = np.asarray(box.rir[0][0][half_filter:])
    length_m = np.arange(len(response)) / RATE_HZ * SPEED_OF_SOUND_MPS
    response = response * 10 ** (-AIR_DB_PER_M * length_m / 20)
    response[length_m < 1.0] = 0.0
    spectrum = np.fft.rfft(np.convolve(response, chirp_at().samples)[: RATE_HZ // 10])
    hz = np.fft.rfftfreq(RATE_HZ // 10, 1 / RATE_HZ)
    spectrum[(hz < BAND_LOW_HZ) | (hz >= BAND_LOW_HZ + BASEBAND_HZ)] = 0.0
    return np.fft.irfft(spectrum)


def test_the_sound_of_a_shoebox_is_that_of_pyroomacoustics() -> None:
    ours, theirs = sound_of(echoes_at(room_of(REFLECTION))), sound_by_pyroomacoustics()
    envelopes = [np.abs(signal.hilbert(sound)) for sound in (ours, theirs)]
    lags = signal.correlate(*envelopes)
    assert abs(np.argmax(lags) - (len(ours) - 1)) <= 1
    assert np.corrcoef(*envelopes)[0, 1] > 0.99
    assert np.corrcoef(ours, theirs)[0, 1] > 0.99, "and so is its carrier"
    assert np.linalg.norm(ours) == pytest.approx(np.linalg.norm(theirs), rel=0.02)


def test_image_sources_are_those_of_pyroomacoustics() -> None:
    box = shoebox(max_order=3)
    box.image_source_model()
    source = box.sources[0]
    images = image_sources(room_of(REFLECTION))
    ours = images.sign * source.position + images.offset_m
    first = 0
    for position, gain in zip(source.images.T, source.damping[0], strict=True):
        distance = np.linalg.norm(ours - position, axis=1)
        if np.allclose(position, source.position):
            first += 1
            assert distance.min() > 1.0, "the direct sound is not among the images"
            continue
        assert distance.min() < 1e-4  # pyroomacoustics keeps single precision
        assert images.gain[distance.argmin()] == pytest.approx(gain, rel=1e-4)
    assert first == 1


# --- a naive sum over paths ---


def naive_images(room: Room, order: int) -> list[tuple[F64, F64, float]]:
    """Sign, offset and gain of every image up to `order` rooms away (Allen and Berkley, 1979)."""
    near, far = room.reflection[::2], room.reflection[1::2]
    images = []
    for n in np.ndindex(*[2 * order + 1] * 3):
        for p in np.ndindex(2, 2, 2):
            away, odd = np.array(n) - order, np.array(p)
            gain = float(np.prod(near ** np.abs(away - odd) * far ** np.abs(away)))
            images.append((1.0 - 2 * odd, 2.0 * away * room.size_m, gain))
    return images


def test_image_sources_are_all_of_the_naive_ones_within_reach() -> None:
    size_m = np.array([11.0, 9.0, 8.0])
    room = room_of(REFLECTION, size_m=size_m)
    ours = image_sources(room)
    assert len(ours.gain) < MOST_IMAGES, "the room is large enough for nothing to be left out"
    kept = {(*s, *o): g for s, o, g in zip(ours.sign, ours.offset_m, ours.gain, strict=True)}
    generator = np.random.default_rng(1)
    inside_reach = 0
    for sign, offset, gain in naive_images(room, order=3):
        speakers = generator.uniform(0.3 * size_m, 0.7 * size_m, (20, 3))
        microphones = speakers + generator.normal(0, 0.1, (20, 3))
        length_m = np.linalg.norm(sign * speakers + offset - microphones, axis=1)
        direct = (sign > 0).all() and (offset == 0).all()
        if length_m.min() < LONGEST_PATH_M and not direct:
            inside_reach += 1
            assert kept[(*sign, *offset)] == pytest.approx(gain)
    assert inside_reach > 100


def test_the_near_end_of_a_long_hall_is_heard() -> None:
    hall = room_of(np.array([0.9, 0.9, 0, 0, 0, 0]), size_m=np.array([100.0, 5.0, 3.0]))
    assert np.abs(echoes_at(hall, place_m=np.array([5.0, 2.0, 1.2]))).max() > 0


def test_too_many_images_leave_the_weakest_out() -> None:
    cabin = room_of(np.full(6, 0.9), size_m=np.array([3.0, 2.5, 2.2]))
    images = image_sources(cabin)
    assert len(images.gain) == MOST_IMAGES
    distance_m = np.linalg.norm((images.sign - 1) * cabin.size_m / 2 + images.offset_m, axis=1)
    assert distance_m.max() < LONGEST_PATH_M
    for sign, offset, _ in naive_images(cabin, order=1):
        if np.linalg.norm((sign - 1) * cabin.size_m / 2 + offset) < 4.0 and (sign < 0).any():
            same = (images.sign == sign).all(axis=1) & (images.offset_m == offset).all(axis=1)
            assert same.sum() == 1, "the early ones are all there"


def naive_path(
    leaving: F64, coming: F64, length_m: float, forward: F64, device: Device
) -> np.complex128:
    """Directivity, the body's shadow, air and phase of one path; unit vectors from the phone."""
    gain = 1.0
    for direction, share in (
        (leaving, device.speaker_directivity),
        (coming, device.microphone_directivity),
    ):
        behind = min(max((-float(direction[:2] @ forward[:2]) - 0.5) / 0.3, 0.0), 1.0)
        gain *= 1 - share + share * float(direction @ forward)
        gain *= 1 - BODY_SHADOW * behind**2 * (3 - 2 * behind)
    hz = BAND_LOW_HZ + BIN_HZ * np.arange(BAND_BINS)
    turns = hz * length_m / SPEED_OF_SOUND_MPS
    return gain * 10 ** (-AIR_DB_PER_M * length_m / 20) * np.exp(-2j * np.pi * turns)  # type: ignore[no-any-return]


def naive_spectrum(room: Room, images: Images, yaw_rad: float, pitch_rad: float) -> C64:
    """The transfer function as a plain sum over the paths of the named phone."""
    device, total = named_device("named"), np.zeros(BAND_BINS, dtype=np.complex128)
    (speaker,), (microphone,), (forward,) = phone_geometry(
        PLACE_M[None], np.array([yaw_rad]), np.array([pitch_rad]), device.separation_m
    )
    for sign, offset, gain in zip(images.sign, images.offset_m, images.gain, strict=True):
        path = sign * speaker + offset - microphone
        length = float(np.linalg.norm(path))
        if length <= LONGEST_PATH_M:
            leaving, coming = -sign * path / length, path / length
            total += gain / length * naive_path(leaving, coming, length, forward, device)
    for point, radius in zip(room.scatterers_m, room.scatterer_radius_m, strict=True):
        there, home = point - speaker, point - microphone
        # The kernel adds a millimetre to each leg, so that no distance is ever zero.
        d_there, d_home = (float(np.linalg.norm(leg)) + 1e-3 for leg in (there, home))
        path = naive_path(there / d_there, home / d_home, d_there + d_home, forward, device)
        total += 0.5 * radius / (d_there * d_home) * path
    return total.astype(np.complex64)


@pytest.mark.parametrize(("yaw_rad", "pitch_rad"), [(0.0, 0.0), (2.1, 0.4), (-1.2, -0.3)])
def test_a_response_is_the_sum_over_its_paths(yaw_rad: float, pitch_rad: float) -> None:
    points = np.random.default_rng(3).uniform([0.5, 0.5, 0], [6.5, 4.5, 1], (30, 3))
    room = room_of(REFLECTION, points)
    device = named_device("named")
    ours = spectrum_of(echoes_at(room, yaw_rad=yaw_rad, pitch_rad=pitch_rad, device=device))[0]
    naive = naive_spectrum(room, image_sources(room), yaw_rad, pitch_rad)
    chirped = slice(bin_of(15_000), bin_of(20_000))
    error = np.linalg.norm((ours - naive)[chirped]) / np.linalg.norm(naive[chirped])
    assert error < 0.02


# --- planted paths ---


def peak_of(sound: F64) -> tuple[int, float]:
    """Sample and height of the strongest arrival, by the line's own matched filter."""
    envelope = matched_envelope(sound.astype(np.float32), chirp_at())
    return int(envelope.argmax()), float(envelope.max())


@pytest.mark.parametrize("away_m", [[2.5, 0.3, -0.4], [-1.5, 2.0, 1.0], [0.3, -0.5, -1.0]])
def test_a_scatterer_is_heard_after_there_and_back(away_m: list[float]) -> None:
    point = PLACE_M + away_m
    there_m = np.linalg.norm(point - beside(0, 0, 0.075))
    home_m = np.linalg.norm(point - beside(0, 0, -0.075))
    sample, height = peak_of(sound_of(echoes_at(anechoic(point))))
    assert sample == pytest.approx((there_m + home_m) / SPEED_OF_SOUND_MPS * RATE_HZ, abs=1.0)
    air = 10 ** (-AIR_DB_PER_M * (there_m + home_m) / 20)
    assert height == pytest.approx(0.5 * 0.1 / (there_m * home_m) * air, rel=0.05)


def test_a_scatterer_fades_with_both_distances() -> None:
    """Twice as far, there and back: a quarter, and what the air takes."""
    level = []
    for distance_m in (1.5, 3.0):
        point = beside(distance_m, 0.0, 0.0)
        there_m = np.hypot(distance_m, 0.075)
        spread = np.abs(spectrum_of(echoes_at(anechoic(point)))[0, bin_of(CARRIER_HZ)])
        level.append(spread * 10 ** (2 * AIR_DB_PER_M * there_m / 20) * there_m**2)
    assert level[0] == pytest.approx(level[1], rel=2e-3)


def test_half_a_cycle_further_turns_the_sign() -> None:
    """A point on the phone's own axis: moving it by a quarter wavelength adds half a cycle."""
    quarter_m = SPEED_OF_SOUND_MPS / CARRIER_HZ / 4
    near, far = (echoes_at(anechoic(beside(0, 0, 1.5 + shift))) for shift in (0.0, quarter_m))
    at = bin_of(CARRIER_HZ)
    ratio = spectrum_of(far)[0, at] / spectrum_of(near)[0, at]
    assert ratio == pytest.approx(-1.0, abs=0.02)
    assert np.corrcoef(sound_of(near), sound_of(far))[0, 1] < -0.85


def test_echoes_of_several_scatterers_add_up() -> None:
    one, other = beside(1.0, 1.0, 0.0), beside(-1.0, 2.0, -0.5)
    together = echoes_at(anechoic(one, other))
    np.testing.assert_allclose(
        together, echoes_at(anechoic(one)) + echoes_at(anechoic(other)), atol=1e-6
    )


def test_nothing_is_heard_beyond_the_longest_path() -> None:
    hall = np.array([40.0, 5.0, 3.0])
    near, far = beside(12.9, 0, 0), beside(13.1, 0, 0)
    assert np.abs(echoes_at(anechoic(near, size_m=hall))).max() > 0
    assert np.abs(echoes_at(anechoic(far, size_m=hall))).max() == 0


@pytest.mark.parametrize("device", [PLAIN, named_device("named")], ids=lambda device: device.name)
def test_what_lies_behind_is_dimmed_by_body_and_directivity(device: Device) -> None:
    ahead, behind = (
        np.linalg.norm(echoes_at(anechoic(beside(side * 2.0, 0, 0)), pitch_rad=0.0, device=device))
        for side in (1, -1)
    )
    lobes = (1 - 2 * device.speaker_directivity) * (1 - 2 * device.microphone_directivity)
    assert behind / ahead == pytest.approx((1 - BODY_SHADOW) ** 2 * lobes, rel=2e-3)


def test_the_direct_sound_and_the_body_come_first() -> None:
    sample, height = peak_of(sound_of(responses_at(anechoic())))
    assert sample == pytest.approx(0.15 / SPEED_OF_SOUND_MPS * RATE_HZ, abs=1.0)
    assert height == pytest.approx(PLAIN.direct_gain / 0.15, rel=0.05)
    quiet = Device(name="quiet", response=np.ones(BAND_BINS), direct_gain=0.0, level=1.0)
    sample, height = peak_of(sound_of(responses_at(anechoic(), device=quiet)))
    assert sample == pytest.approx(0.7 / SPEED_OF_SOUND_MPS * RATE_HZ, abs=1.0)
    assert height == pytest.approx(BODY_REFLECTION / 0.7, rel=0.05)


# --- laws ---


def test_speaker_and_microphone_may_change_places() -> None:
    """Reciprocity: upside down, the phone plays where it listened."""
    room = room_of(REFLECTION, beside(1.0, 1.0, 0.3))
    up, down = (
        spectrum_of(echoes_at(room, pitch_rad=turn))[0] for turn in (UPRIGHT_RAD, -UPRIGHT_RAD)
    )
    assert np.linalg.norm(up - down) < 5e-3 * np.linalg.norm(up)


def test_every_row_is_by_itself_and_always_the_same() -> None:
    room = room_of(REFLECTION, beside(1.0, 1.0, 0.0))
    generator = np.random.default_rng(0)
    places = generator.uniform([1, 1, 1], [6, 4, 1.4], (5, 3))
    yaw, pitch = generator.uniform(-3, 3, 5), generator.uniform(0, 1, 5)
    images, device, body = image_sources(room), named_device("named"), np.full(5, 0.35)
    whole = room_responses(room, images, device, places, yaw, pitch, body)
    again = room_responses(room, images, device, places, yaw, pitch, body)
    assert whole.tobytes() == again.tobytes()
    for k in range(5):
        rows = slice(k, k + 1)
        alone = room_responses(
            room, images, device, places[rows], yaw[rows], pitch[rows], body[rows]
        )
        assert (alone[0] == whole[k]).all()


def test_a_mirrored_room_with_a_mirrored_phone_sounds_the_same() -> None:
    point = np.array([4.0, 1.0, 0.5])
    room = room_of(REFLECTION, point)
    mirrored = room_of(
        REFLECTION[[0, 1, 3, 2, 4, 5]], np.array([point[0], SIZE_M[1] - point[1], point[2]])
    )
    place = np.array([PLACE_M[0], SIZE_M[1] - PLACE_M[1], PLACE_M[2]])
    here = echoes_at(room, yaw_rad=0.7, pitch_rad=0.3)
    there = echoes_at(mirrored, place_m=place, yaw_rad=-0.7, pitch_rad=0.3)
    assert np.linalg.norm(here - there) < 5e-3 * np.linalg.norm(here)


def test_an_empty_even_room_looks_the_same_after_half_a_turn() -> None:
    """Why furniture and materials matter: nothing else tells the two places apart."""
    even, uneven = room_of(REFLECTION[[0, 0, 2, 2, 4, 5]]), room_of(REFLECTION)
    across = np.array([*(SIZE_M - PLACE_M)[:2], PLACE_M[2]])
    for room, expected in ((even, True), (uneven, False)):
        here = echoes_at(room, yaw_rad=0.7, pitch_rad=0.3)
        there = echoes_at(room, place_m=across, yaw_rad=0.7 + np.pi, pitch_rad=0.3)
        same = np.linalg.norm(here - there) < 5e-3 * np.linalg.norm(here)
        assert same == expected


@pytest.mark.parametrize("rate_hz", [44_100, 48_000])
def test_a_frame_is_one_period_of_sound_within_the_band(rate_hz: int) -> None:
    room = room_of(REFLECTION, beside(1.0, 1.0, 0.0))
    frames = render_frames(responses_at(room), chirp_at(rate_hz), PLAIN)
    assert frames.shape == (1, rate_hz // 10)
    assert frames.dtype == np.float32
    power = np.abs(np.fft.rfft(frames[0])) ** 2
    hz = np.fft.rfftfreq(rate_hz // 10, 1 / rate_hz)
    inside = (hz >= BAND_LOW_HZ) & (hz < BAND_LOW_HZ + BASEBAND_HZ)
    assert power[~inside].sum() < 1e-9 * power.sum()
    chirped = (hz > 15_000) & (hz < 20_000)
    assert power[chirped].sum() > 0.97 * power.sum()


def test_both_rates_give_the_same_sound() -> None:
    responses = responses_at(room_of(REFLECTION, beside(1.0, 1.0, 0.0)))
    slow, fast = sound_of(responses, 44_100), sound_of(responses, 48_000)
    again = signal.resample(slow, len(fast))
    assert np.corrcoef(again, fast)[0, 1] > 0.999
    assert np.linalg.norm(again) == pytest.approx(np.linalg.norm(fast), rel=0.01)


def test_the_phone_colours_the_sound() -> None:
    """Level and response multiply the spectrum."""
    responses = responses_at(room_of(REFLECTION))
    device = named_device("named")
    plain, coloured = (
        np.fft.rfft(render_frames(responses, chirp_at(), made)[0]) for made in (PLAIN, device)
    )
    band = slice(bin_of(15_000) + 1435, bin_of(20_000) + 1435)
    expected = device.level * device.response[band.start - 1435 : band.stop - 1435]
    np.testing.assert_allclose(np.abs(coloured[band] / plain[band]), expected, rtol=1e-2)
