"""Phones in a scene: axes, ends, the same bytes by any number of threads, and their sound."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy import signal

from elfslam.base.arrays import F64
from elfslam.base.errors import ParameterError
from elfslam.base.values import Chirp
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, Device, band_hz, built_in_device
from elfslam.world.materials import material
from elfslam.world.paths import MOST_REFLECTIONS, Reach
from elfslam.world.phone import (
    BODY_DISTANCE_M,
    BODY_REFLECTION,
    Poses,
    air_at,
    ends_of,
    image_echoes,
    phone_axes,
    poses_at,
    render_frames,
    room_responses,
)
from elfslam.world.pulses import BASEBAND_HZ, CARRIER_HZ, absorption_db_per_m
from elfslam.world.room import box, shoebox
from elfslam.world.scene import Scene, scene_of
from elfslam.world.transducers import HAND, Lobes, Resonance, near_field, ringing

C64 = npt.NDArray[np.complex64]
PLAIN = Device(
    "plain", np.ones(BAND_BINS), speaker_directivity=0.0, microphone_directivity=0.0, level=1.0
)


def scene() -> Scene:
    names = ("door", "glass", "brick", "plaster", "carpet", "concrete")
    surfaces = [material(name) for name in names]
    table = box("table", [1.0, 1.0, 0.0], [1.5, 0.8, 0.7])
    return scene_of(shoebox(np.array([6.0, 4.0, 2.5]), tuple(surfaces), (table,)))


def some_poses(count: int) -> Poses:
    generator = np.random.default_rng(0)
    places = generator.uniform([0.5, 2.2, 1], [5.5, 3.5, 1.4], (count, 3))
    yaw, pitch = generator.uniform(-3, 3, count), generator.uniform(0, 1, count)
    return poses_at(places, yaw, pitch, 0.1)


def chirp_at(rate_hz: int = 44_100) -> Chirp:
    return make_chirp(ChirpParameters(), rate_hz)


def test_a_level_phone_has_its_right_to_the_right() -> None:
    """Yaw 90 degrees: the top points along y, the right side along x, the screen up."""
    (axes,) = phone_axes(np.array([np.pi / 2]), np.zeros(1), np.zeros(1))
    np.testing.assert_allclose(axes.T, [[1, 0, 0], [0, 1, 0], [0, 0, 1]], atol=1e-12)


def test_pitch_lifts_the_top_and_roll_the_left_side() -> None:
    (axes,) = phone_axes(np.zeros(1), np.array([np.pi / 2]), np.zeros(1))
    np.testing.assert_allclose(axes[:, 1], [0, 0, 1], atol=1e-12)
    (axes,) = phone_axes(np.zeros(1), np.zeros(1), np.array([np.pi / 2]))
    np.testing.assert_allclose(axes[:, 0], [0, 0, -1], atol=1e-12)


def test_ends_are_where_the_device_has_them() -> None:
    device = Device(
        "odd", np.ones(BAND_BINS), speaker_m=np.array([0.01, 0.08, 0.0]),
        microphone_m=np.array([0.0, -0.07, 0.005]), microphone_axis=np.array([0.0, 0.0, 1.0]),
    )  # fmt: skip
    poses = poses_at(np.array([[1.0, 2.0, 1.2]]), np.full(1, np.pi / 2), np.zeros(1))
    ends = ends_of(device, poses)
    np.testing.assert_allclose(ends.speaker, [[1.01, 2.08, 1.2]])
    np.testing.assert_allclose(ends.microphone, [[1.0, 1.93, 1.205]])
    np.testing.assert_allclose(ends.microphone_axis, [[0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(ends.ahead, [[0, 1]], atol=1e-12)
    assert ends.held


def test_lobes_turn_with_the_phone() -> None:
    """What lies across is half the spacing in wavelengths: 7 cm are 1.79 to each side."""
    device = replace(
        PLAIN, speaker_lobes=Lobes(0.3, 0.07),
        microphone_lobes=Lobes(0.2, 0.03, np.array([0.0, 0.0, 1.0])),
    )  # fmt: skip
    up = np.full(1, np.pi / 2)
    ends = ends_of(device, poses_at(np.array([[1.0, 2.0, 1.2]]), up, up))
    waves = CARRIER_HZ / 343.0
    np.testing.assert_allclose(ends.speaker_across, [[0.035 * waves, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(ends.microphone_across, [[0, -0.015 * waves, 0]], atol=1e-12)
    assert (ends.speaker_lobe_share, ends.microphone_lobe_share) == (0.3, 0.2)
    poses = some_poses(2)
    air, nobody = air_at(), some_poses(2).people_m
    both = (ends_of(made, poses) for made in (device, PLAIN))
    lobed, plain = (image_echoes(scene(), ends, nobody, air, Reach()) for ends in both)
    assert 0.2 < np.linalg.norm(lobed) / np.linalg.norm(plain) < 0.9


@pytest.mark.parametrize(
    ("temperature_c", "speed_mps"), [(20.0, 343.2), (0.0, 331.3), (40.0, 354.7)]
)
def test_air_is_that_of_its_temperature(temperature_c: float, speed_mps: float) -> None:
    air = air_at(temperature_c)
    assert air.speed_mps == pytest.approx(speed_mps, abs=0.1)
    lost_db = -20 * np.log10(np.exp(-air.attenuation_per_m))
    assert lost_db == pytest.approx(absorption_db_per_m(CARRIER_HZ, temperature_c))


def test_every_row_is_by_itself() -> None:
    poses, device = some_poses(3), built_in_device("flat")
    whole = room_responses(scene(), device, poses)
    for k in range(3):
        rows = slice(k, k + 1)
        alone = Poses(
            poses.position_m[rows], poses.world_from_phone[rows], poses.velocity_mps[rows],
            poses.body_distance_m[rows], poses.people_m[rows],
        )  # fmt: skip
        assert room_responses(scene(), device, alone)[0].tobytes() == whole[k].tobytes()


@pytest.mark.parametrize(
    "reach", [Reach(plan_order=MOST_REFLECTIONS + 1), Reach(longest_m=0.0)], ids=str
)
def test_a_reach_that_cannot_be_is_refused(reach: Reach) -> None:
    poses = some_poses(1)
    with pytest.raises(ParameterError, match="wanted at most 24 reflections in plan and a posit"):
        image_echoes(scene(), ends_of(PLAIN, poses), poses.people_m, air_at(), reach)


def test_too_many_paths_are_refused() -> None:
    strips = tuple(box(f"{k}", [0.02 + 0.03 * k, 0.0, 0.0], [0.01, 1.0, 0.5]) for k in range(30))
    tiny = scene_of(shoebox(np.array([1.0, 1.0, 3.0]), (material("glass"),) * 6, strips))
    poses = poses_at(np.array([[0.4, 0.45, 1.2]]), np.zeros(1), np.zeros(1))
    reach = Reach(longest_m=60.0, plan_order=24)
    with pytest.raises(ParameterError, match="more paths than fit; lower its order"):
        image_echoes(tiny, ends_of(PLAIN, poses), poses.people_m, air_at(), reach)


def test_another_engine_hears_the_near_field_too() -> None:
    """The direct sound and the holder come from here, whatever the engine."""
    poses = some_poses(2)
    nothing = np.zeros((2, BAND_BINS), np.complex64)
    deaf = room_responses(scene(), PLAIN, poses, engine=lambda *given: nothing)
    sound = np.abs(signal.hilbert(sound_of(deaf[:1])))
    expected_s = PLAIN.separation_m / air_at().speed_mps + 0.005
    assert np.abs(deaf[0]).argmax() <= 3
    assert sound[round(expected_s * 44_100)] == pytest.approx(PLAIN.direct_gain / 0.15, rel=0.1)
    quiet = room_responses(
        scene(), replace(PLAIN, direct_gain=0.0), poses,
        engine=lambda scene, ends, *rest: np.zeros((2, BAND_BINS), np.complex64),
    )  # fmt: skip
    late = 2 * BODY_DISTANCE_M / air_at().speed_mps * BASEBAND_HZ
    assert np.abs(quiet[0]).argmax() == pytest.approx(late, abs=0.6)
    level = np.linalg.norm(quiet[0])
    assert level == pytest.approx(BODY_REFLECTION / (2 * BODY_DISTANCE_M), rel=0.1)


def sound_of(responses: C64, rate_hz: int = 44_100, device: Device = PLAIN) -> F64:
    return render_frames(responses, chirp_at(rate_hz), device)[0].astype(np.float64)


@pytest.mark.parametrize("rate_hz", [44_100, 48_000])
def test_a_frame_is_one_period_of_sound_within_the_band(rate_hz: int) -> None:
    frames = render_frames(room_responses(scene(), PLAIN, some_poses(1)), chirp_at(rate_hz), PLAIN)
    assert frames.shape == (1, rate_hz // 10)
    assert frames.dtype == np.float32
    power = np.abs(np.fft.rfft(frames[0])) ** 2
    hz = np.fft.rfftfreq(rate_hz // 10, 1 / rate_hz)
    inside = (hz >= BAND_LOW_HZ) & (hz < BAND_LOW_HZ + BASEBAND_HZ)
    assert power[~inside].sum() < 1e-9 * power.sum()
    chirped = (hz > 15_000) & (hz < 20_000)
    assert power[chirped].sum() > 0.97 * power.sum()


def test_the_phone_colours_the_sound() -> None:
    """Level and response multiply the spectrum."""
    responses, device = room_responses(scene(), PLAIN, some_poses(1)), built_in_device("rippled")
    plain, coloured = (np.fft.rfft(sound_of(responses, device=made)) for made in (PLAIN, device))
    first, low, high = (round(hz / BIN_HZ) for hz in (BAND_LOW_HZ, 15_000, 20_000))
    expected = device.level * device.response[low - first : high - first]
    # Where echoes cancel, single precision leaves nothing to divide.
    loud = np.abs(plain[low:high]) > 0.05 * np.abs(plain).max()
    ratio = np.abs(coloured[low:high] / plain[low:high])
    assert loud.sum() > 200
    np.testing.assert_allclose(ratio[loud], expected[loud], rtol=1e-2)


def test_a_phone_rings_after_the_sound() -> None:
    """The spectrum is the plain one times the ringing's, and it sounds on after the chirp."""
    modes = (Resonance(19_700.0, 60.0, 1.2),)
    responses = np.zeros((1, BAND_BINS), np.complex64)
    responses[0, 20] = 1.0
    rung = sound_of(responses, device=replace(PLAIN, ringing=modes))
    plain = sound_of(responses)
    first, low, high = (round(hz / BIN_HZ) for hz in (BAND_LOW_HZ, 15_000, 20_000))
    ratio = (np.fft.rfft(rung) / np.fft.rfft(plain))[low:high]
    hz = BAND_LOW_HZ + BIN_HZ * np.arange(low - first, high - first)
    np.testing.assert_allclose(ratio, ringing(modes, hz), rtol=1e-3)
    chirp_end = round(44_100 * (20 / BASEBAND_HZ + 0.010)) + 20
    late = slice(chirp_end, chirp_end + 60)
    assert np.linalg.norm(rung[late]) > 3 * np.linalg.norm(plain[late])


def test_the_holder_scatters_echoes_and_leaves_the_direct_sound() -> None:
    poses, gain = some_poses(3), np.fft.ifftshift(near_field(HAND, band_hz()))
    phones = PLAIN, replace(PLAIN, near_field=HAND)
    bare, held = (room_responses(scene(), phone, poses) for phone in phones)
    air, ends = air_at(), ends_of(PLAIN, poses)
    echoes = image_echoes(scene(), ends, poses.people_m, air, Reach())
    scattered = np.fft.ifft(np.fft.fft(echoes, axis=1) * gain, axis=1)
    np.testing.assert_allclose(held - bare, scattered - echoes, atol=2e-5)
