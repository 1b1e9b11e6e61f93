"""Ordinary phones: what they have, how they ring, what is heard above their noise and besides."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world import transducers
from elfslam.world.circumstances import Circumstances, device_of
from elfslam.world.device import Device, band_hz, built_in_device, random_device
from elfslam.world.diffuse import diffuse_echoes
from elfslam.world.interference import RUMBLE_LEVEL, clicks, music_like, record, rumble, speech_like
from elfslam.world.phone import Engine, poses_at, render_frames, room_responses
from elfslam.world.pulses import SPEED_OF_SOUND_MPS
from elfslam.world.room import Room
from elfslam.world.scattering import as_measured, scattering_of
from elfslam.world.scene import scene_of
from elfslam.world.transducers import HEARD_HZ, Resonance, controlled, near_field, ringing
from elfslam.world.world_file import load_world

RATE_HZ = 44_100
BUILT_IN = ("ordinary phone", "other ordinary phone")


def some_phones(count: int) -> list[Device]:
    generator = np.random.default_rng(4)
    return [random_device(generator, ordinary=True) for _ in range(count)]


@pytest.fixture(scope="module")
def studio() -> tuple[Room, Engine]:
    room = as_measured(load_world("studio").room)
    return room, partial(diffuse_echoes, scattering=scattering_of(room))


def echoes_over_noise_db(studio: tuple[Room, Engine], device: Device) -> float:
    """Between 15.2 and 19.8 kHz, 11 to 64 ms after the direct sound, in the median of places."""
    room, engine = studio
    generator = np.random.default_rng(0)
    xy = room.corner_m + generator.uniform(0.0, 1.0, (300, 2)) * room.size_m[:2]
    xy = xy[room.is_free(xy, 1.2, 0.3)][:24]
    poses = poses_at(np.column_stack([xy, np.full(len(xy), 1.2)]), xy[:, 0] * 7, 0 * xy[:, 0] + 0.4)
    chirp = make_chirp(ChirpParameters(), RATE_HZ)
    responses = room_responses(scene_of(room), device, poses, engine=engine)
    frames = render_frames(responses, chirp, device)
    band = signal.butter(6, (15_200, 19_800), "bandpass", fs=RATE_HZ, output="sos")
    noise = device.noise_rms * np.random.default_rng(1).standard_normal(frames.shape)
    direct_s = device.separation_m / SPEED_OF_SOUND_MPS
    window = slice(round((direct_s + 0.011) * RATE_HZ), round((direct_s + 0.064) * RATE_HZ))
    heard = (signal.sosfiltfilt(band, sound, axis=1)[:, window] for sound in (frames, noise))
    power = [np.mean(sound**2, axis=1) for sound in heard]
    return float(np.median(10 * np.log10(power[0] / power[1])))


@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize(("volume", "low_db", "high_db"), [(1.0, 18, 25), (0.2, 5, 11)])
def test_the_volume_matters(
    studio: tuple[Room, Engine], name: str, volume: float, low_db: float, high_db: float
) -> None:
    device = device_of(Circumstances(device=name, volume=volume))
    assert low_db < echoes_over_noise_db(studio, device) < high_db


def test_random_ones_hear_as_much_noise_as_measured_ones(studio: tuple[Room, Engine]) -> None:
    """Measured, at 11 to 20 ms: 2 to 18 dB."""
    over_db = [echoes_over_noise_db(studio, phone) for phone in some_phones(24)]
    assert 2 < np.median(over_db) < 12
    assert min(over_db) > -10
    assert 15 < max(over_db) < 28


def test_they_ring_for_tenths_of_a_millisecond() -> None:
    modes = [mode for phone in some_phones(30) for mode in phone.ringing]
    decays_s = np.array([mode.decay_s for mode in modes])
    assert 0.1e-3 <= decays_s.min() < 0.13e-3
    assert 0.37e-3 < decays_s.max() <= 0.4e-3
    assert all(HEARD_HZ[0] <= mode.frequency_hz <= HEARD_HZ[1] for mode in modes)
    assert {np.sign(mode.gain) for mode in modes} == {-1.0, 1.0}
    assert {len(phone.ringing) for phone in some_phones(30)} == {2, 3, 4}


def test_they_have_lobes_and_some_ride_their_gain() -> None:
    phones = some_phones(60)
    for phone in phones:
        assert 0.15 <= phone.speaker_lobes.share <= 0.4
        assert 0.05 <= phone.microphone_lobes.share <= 0.25
        assert np.linalg.norm(phone.speaker_lobes.axis) == pytest.approx(1.0)
    across = np.array([phone.speaker_lobes.axis for phone in phones])
    assert np.abs(across[:, 0]).mean() > 0.7
    assert np.abs(across[:, 1:]).mean() > 0.1
    controlled = np.mean([phone.gain_control is not None for phone in phones])
    assert controlled == pytest.approx(transducers.CONTROLLED_SHARE, abs=0.2)


NEAR = transducers.NearField(0.8, 0.5e-3, seed=3)


def test_the_near_field_has_the_power_that_it_says_and_dies_as_it_says() -> None:
    rate_hz, count = 1e6, 2**14
    heard = np.fft.irfft(near_field(NEAR, np.fft.rfftfreq(count, 1 / rate_hz)) - 1.0, count)
    power = np.mean(np.abs(near_field(NEAR, np.linspace(0, 1e6, 100_001))) ** 2)
    assert power == pytest.approx(1 + 0.8**2, rel=0.02)
    energy, t_s = heard**2 / np.sum(heard**2), np.arange(count) / rate_hz
    assert np.sum(energy * t_s) == pytest.approx(NEAR.decay_s, rel=0.1)
    assert energy[t_s > 10 * NEAR.decay_s].sum() < 0.01  # what there is comes before time 0


def test_another_holder_scatters_otherwise() -> None:
    one, other = (near_field(replace(NEAR, seed=seed), band_hz()) for seed in (1, 2))
    assert abs(np.corrcoef(np.abs(one), np.abs(other))[0, 1]) < 0.5
    assert (near_field(replace(NEAR, gain=0.0), band_hz()) == 1.0).all()


CONTROL = transducers.GainControl(
    attack_s=0.004, release_s=0.2, target_level=0.05, most_gain_db=24.0
)


def tone(rms: float | F64, duration_s: float = 3.0) -> F32:
    t_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    return (rms * np.sqrt(2) * np.sin(2 * np.pi * 17_321.0 * t_s)).astype(np.float32)


def gain_db(before: F32, after: F32) -> F64:
    """In every millisecond."""
    energy = [(s.astype(float)[: len(s) // 44 * 44].reshape(-1, 44) ** 2).sum(axis=1)
              for s in (before, after)]  # fmt: skip
    return np.asarray(10 * np.log10(energy[1] / energy[0]))


def rms(sound: F32) -> float:
    return float(np.sqrt(np.mean(sound.astype(float) ** 2)))


@pytest.mark.parametrize("level", [0.004, 0.05, 0.4])
def test_a_steady_tone_comes_out_at_the_target(level: float) -> None:
    heard = controlled(tone(level), CONTROL, RATE_HZ)
    assert rms(heard[-RATE_HZ // 2 :]) == pytest.approx(0.05, rel=0.01)
    assert heard.dtype == np.float32


def test_what_is_too_soft_gets_the_most_gain_and_no_more() -> None:
    soft = tone(1e-4)
    heard = controlled(soft, CONTROL, RATE_HZ)
    assert gain_db(soft, heard)[-1] == pytest.approx(24.0, abs=0.01)
    assert gain_db(soft, heard).max() < 24.01


@pytest.mark.parametrize("release_s", [0.1, 0.4])
def test_after_a_loud_chirp_the_gain_recovers_with_its_time_constant(release_s: float) -> None:
    t_s = np.arange(3 * RATE_HZ) / RATE_HZ
    sound = tone(np.where((t_s > 1.5) & (t_s < 1.53), 0.3, 0.004))
    control = replace(CONTROL, release_s=release_s)
    gain = gain_db(sound, controlled(sound, control, RATE_HZ))
    rest_db = 20 * np.log10(0.05 / 0.004)
    recovering = slice(1580, 1580 + round(500 * release_s))  # the level has come down by then
    below_db = rest_db - gain[recovering]
    ms = np.arange(len(below_db)) * 44_000 / RATE_HZ
    tau_s = -1e-3 / np.polyfit(ms, np.log(below_db), 1)[0]
    assert tau_s == pytest.approx(release_s, rel=0.03)
    assert gain[1526] == pytest.approx(20 * np.log10(0.05 / 0.3), abs=0.5)


@pytest.mark.parametrize("attack_s", [0.02, 0.06])
def test_a_louder_tone_is_turned_down_with_the_attack(attack_s: float) -> None:
    t_s = np.arange(3 * RATE_HZ) / RATE_HZ
    sound = tone(np.where(t_s > 1.5, 0.3, 0.02))
    gain = gain_db(sound, controlled(sound, replace(CONTROL, attack_s=attack_s), RATE_HZ))
    above_db = gain[1515 : 1515 + round(1000 * attack_s)] - 20 * np.log10(0.05 / 0.3)
    tau_s = -1e-3 / np.polyfit(np.arange(len(above_db)) * 44_000 / RATE_HZ, np.log(above_db), 1)[0]
    assert tau_s == pytest.approx(attack_s, rel=0.05)


def test_what_comes_before_the_attack_is_limited() -> None:
    """The gain has risen in silence; the burst would be 24 dB louder than it is."""
    t_s = np.arange(3 * RATE_HZ) / RATE_HZ
    sound = tone(np.where(t_s > 2.0, 0.3, 1e-4))
    heard = controlled(sound, CONTROL, RATE_HZ, clip_level=0.9)
    assert np.abs(heard).max() == np.float32(0.9)
    assert (np.abs(heard[: 2 * RATE_HZ]) < 0.01).all()


RINGING_RATE_HZ, COUNT = 3.2e6, 2**16
MODES = (Resonance(15_600.0, 8.0, 0.7), Resonance(17_300.0, 30.0, -0.5))


def impulse_response(*modes: Resonance) -> F64:
    """What is heard of an impulse at sample 0 beside the direct sound; the last half is before."""
    frequency_hz = np.fft.rfftfreq(COUNT, 1 / RINGING_RATE_HZ)
    return np.asarray(np.fft.irfft(ringing(modes, frequency_hz) - 1.0, COUNT))


@pytest.mark.parametrize("mode", MODES)
def test_a_resonance_rings_down_as_its_quality_says(mode: Resonance) -> None:
    """exp(-pi f t / Q): from one cycle to the next, over five times the decay."""
    heard = impulse_response(mode)
    cycle = RINGING_RATE_HZ / (mode.frequency_hz * np.sqrt(1 - 0.25 / mode.q**2))
    starts = (np.arange(int(5 * mode.decay_s * mode.frequency_hz)) * cycle).astype(int)
    peaks = np.array([np.abs(heard[a : a + int(cycle)]).max() for a in starts])
    rate_per_s = -np.polyfit(starts / RINGING_RATE_HZ, np.log(peaks), 1)[0]
    assert rate_per_s == pytest.approx(np.pi * mode.frequency_hz / mode.q, rel=0.01)
    assert mode.decay_s == pytest.approx(1 / rate_per_s, rel=0.01)


def test_nothing_rings_before_the_sound() -> None:
    heard = impulse_response(*MODES)
    before, after = heard[COUNT // 2 :], heard[: COUNT // 2]
    assert (before**2).sum() < 1e-3 * (after**2).sum()
    # What there is of it is the band's end at 1.6 MHz, next to the jump at time 0.
    assert np.abs(before[:-40]).max() < 5e-3 * np.abs(after).max()


@pytest.mark.parametrize("mode", MODES)
def test_a_resonance_has_its_gain_at_its_peak_and_half_its_power_beside(mode: Resonance) -> None:
    half = mode.frequency_hz * (np.sqrt(1 + 0.25 / mode.q**2) + np.array([-0.5, 0.5]) / mode.q)
    frequency_hz = np.array([*half, mode.frequency_hz])
    low, high, peak = ringing((mode,), frequency_hz) - 1.0
    assert peak == pytest.approx(mode.gain)
    assert np.abs([low, high]) == pytest.approx(abs(mode.gain) / np.sqrt(2))


def test_resonances_add_up_beside_the_direct_sound() -> None:
    frequency_hz = np.linspace(15_000.0, 20_000.0, 7)
    alone = [ringing((mode,), frequency_hz) - 1.0 for mode in MODES]
    assert ringing(MODES, frequency_hz) == pytest.approx(1.0 + sum(alone))
    assert (ringing((), frequency_hz) == 1.0).all()


REFUSED = {
    transducers.NearField: [(-0.1, 1e-3), (0.5, 0.0), (np.nan, 1e-3)],
    transducers.GainControl: [(0.0,), (0.1, -1.0), (0.1, 0.1, 0.0), (0.1, 0.1, 0.1, -3.0)],
    transducers.Lobes: [(-0.1, 0.05), (1.1, 0.05), (0.3, -0.01)],
    Resonance: [(0.0, 5.0, 1.0), (17e3, 0.5, 1.0), (17e3, 5.0, np.nan)],
}
SAID = {
    transducers.NearField: "near field: wanted a gain from 0 and a decay above 0",
    transducers.GainControl: "gain control: wanted times and a target above 0",
    transducers.Lobes: "lobes: wanted a share from 0 to 1 and a spacing from 0",
    Resonance: r"resonance: wanted a positive frequency, a q above 0\.5",
}


@pytest.mark.parametrize("kind", SAID)
def test_what_cannot_be_is_refused(kind: type) -> None:
    for wrong in REFUSED[kind]:
        with pytest.raises(InputError, match=SAID[kind]):
            kind(*wrong)


SILENT = replace(built_in_device("flat"), noise_rms=0.0)
Sound = Callable[[int, int, np.random.Generator, float], F32]


def generator_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def share_db(sound: F32, low_hz: float, high_hz: float, rate_hz: int = RATE_HZ) -> float:
    """Power between two frequencies relative to all of it."""
    power = np.abs(np.fft.rfft(sound.astype(np.float64))) ** 2
    frequency_hz = np.fft.rfftfreq(len(sound), 1 / rate_hz)
    inside = (frequency_hz >= low_hz) & (frequency_hz < high_hz)
    return float(10 * np.log10(power[inside].sum() / power.sum()))


@pytest.mark.parametrize("make", [speech_like, music_like])
@pytest.mark.parametrize("level", [0.003, 0.2])
def test_speech_and_music_have_the_rms_asked_for(make: Sound, level: float) -> None:
    sound = make(5 * RATE_HZ, RATE_HZ, generator_of(2), level)
    assert np.sqrt(np.mean(sound.astype(np.float64) ** 2)) == pytest.approx(level, rel=1e-5)


@pytest.mark.parametrize("rate_hz", [44_100, 48_000])
def test_a_little_of_speech_reaches_the_band(rate_hz: int) -> None:
    sound = speech_like(15 * rate_hz, rate_hz, generator_of(0), 0.05)
    assert -50 < share_db(sound, 15_000, 20_000, rate_hz) < -40
    assert share_db(sound, 80, 8_000, rate_hz) > -0.3
    assert share_db(sound, 80, 4_000, rate_hz) > -0.5


def test_speech_has_pauses_and_a_pitch() -> None:
    sound = speech_like(20 * RATE_HZ, RATE_HZ, generator_of(5), 0.05)
    rms = np.sqrt((sound.reshape(-1, RATE_HZ // 50) ** 2).mean(axis=1))
    assert 0.05 < np.mean(rms < 1e-4) < 0.5
    spectrum = np.abs(np.fft.rfft(sound.astype(np.float64)))
    frequency_hz = np.fft.rfftfreq(len(sound), 1 / RATE_HZ)
    assert spectrum[frequency_hz < 70].max() < 0.1 * spectrum.max()


def test_cymbals_of_music_reach_the_band() -> None:
    sound = music_like(15 * RATE_HZ, RATE_HZ, generator_of(0), 0.05)
    assert -36 < share_db(sound, 15_000, 20_000) < -28
    assert share_db(sound, 200, 6_000) > -0.3


def test_clicks_come_as_often_as_asked_for() -> None:
    """At 1.5 per second over 200 s: 300 give or take four times the root of that."""
    sound = clicks(200 * RATE_HZ, RATE_HZ, generator_of(7), 0.1, per_s=1.5)
    onset = np.flatnonzero(np.abs(sound) > 5e-4)
    # Clicks closer than 30 ms run together: 1.5 * 0.03 of them.
    heard = 1 + np.count_nonzero(np.diff(onset) > 0.02 * RATE_HZ)
    assert abs(heard - 300 * (1 - 1.5 * 0.03)) < 4 * np.sqrt(300)


def test_clicks_are_in_the_band_and_as_loud_as_asked_for() -> None:
    sound = clicks(100 * RATE_HZ, RATE_HZ, generator_of(9), 0.05, per_s=1.0)
    assert share_db(sound, 12_500, 21_500) > -0.5
    assert share_db(sound, 15_000, 20_000) > -4
    peaks = np.abs(sound).reshape(200, -1).max(axis=1)
    assert np.median(peaks[peaks > 5e-3]) == pytest.approx(0.05, rel=0.35)
    assert not clicks(RATE_HZ, RATE_HZ, generator_of(9), 0.05, per_s=0.0).any()


def test_rumble_is_low_and_the_one_of_old() -> None:
    sound = rumble(10 * RATE_HZ, RATE_HZ, generator_of(3))
    white = generator_of(3).standard_normal(10 * RATE_HZ)
    low_pass = signal.butter(2, 4_000, fs=RATE_HZ, output="sos")
    np.testing.assert_allclose(sound, 3e-4 * signal.sosfilt(low_pass, white), rtol=1e-6)
    assert RUMBLE_LEVEL == 3e-4
    assert sound.std() == pytest.approx(1.33e-4, rel=0.02)
    assert share_db(sound, 15_000, 20_000) < -35


def test_the_noise_floor_is_the_phones() -> None:
    phone = built_in_device("cheap")
    floor = record(np.zeros(200_000, dtype=np.float32), phone, generator_of(0))
    assert floor.dtype == np.float32
    assert floor.std() == pytest.approx(phone.noise_rms, rel=0.01)
    assert share_db(floor, 15_000, 20_000) == pytest.approx(10 * np.log10(5_000 / 22_050), abs=0.1)


@pytest.mark.parametrize("skew_ppm", [20.0, -20.0, 300.0])
def test_the_clock_moves_a_late_chirp_by_what_it_gained(skew_ppm: float) -> None:
    """A pulse at sample k of what was played stands at k (1 + skew)."""
    phone = replace(SILENT, clock_skew_ppm=skew_ppm)
    count, at = 500_000, 450_000
    pulse = signal.gausspulse((np.arange(count) - at) / RATE_HZ, fc=17_500, bw=0.1)
    recorded = record(pulse.astype(np.float32), phone, generator_of(0))
    envelope = np.abs(signal.hilbert(recorded[at - 500 : at + 500])) ** 2
    centre = at - 500 + float(np.average(np.arange(1000), weights=envelope))
    assert centre - at == pytest.approx(at * skew_ppm * 1e-6, abs=0.01)


def test_a_slow_clock_ends_in_silence_and_a_fast_one_before_the_end() -> None:
    count = 100_000
    sound = np.ones(count, dtype=np.float32)
    slow = record(sound, replace(SILENT, clock_skew_ppm=-1_000.0), generator_of(0))
    fast = record(sound, replace(SILENT, clock_skew_ppm=1_000.0), generator_of(0))
    assert len(slow) == len(fast) == count
    assert not slow[-60:].any()
    assert np.abs(slow[50:-150] - 1).max() < 1e-3
    assert np.abs(fast[50:] - 1).max() < 1e-3
