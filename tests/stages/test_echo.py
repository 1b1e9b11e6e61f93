"""Echoes are cut where they were planted, whatever happens to the stream."""

import dataclasses
import tracemalloc
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
import soundfile
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_SAMPLES, Audio, Chirp, Echoes
from elfslam.stages import echo
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo.arrivals import find_frames

RATE_HZ = 44_100
FRAME = 4_410
PARAMETERS = echo.EchoParameters()
ROOM = ((0.0183, 0.3), (0.031, 0.2), (0.047, 0.1))
"""Planted echoes: delay behind the direct arrival (s) and gain."""
QUIET_S = 0.085
"""Behind a direct arrival: chirp and echoes are over, so a stream cut here cuts no chirp."""


def chirp_at(rate_hz: int = RATE_HZ) -> Chirp:
    return make_chirp(ChirpParameters(), rate_hz)


def stream(
    arrivals_s: Sequence[float] | F64,
    seconds: float,
    *,
    rate_hz: int = RATE_HZ,
    echoes: Sequence[tuple[float, float]] = ROOM,
    level: float = 0.2,
    noise: float = 1e-5,
) -> F32:
    """A stream with a chirp and its echoes at each arrival, placed to fractions of a sample."""
    pad, block = 64, round(0.1 * rate_hz)
    spectrum = np.fft.rfft(chirp_at(rate_hz).samples, block + pad)
    turns = np.fft.rfftfreq(block + pad)
    samples = np.zeros(round(seconds * rate_hz) + 2 * block)
    for arrival in np.asarray(arrivals_s) * rate_hz:
        whole = int(arrival)
        delays = [(0.0, 1.0), *echoes]
        shift = sum(
            gain * np.exp(-2j * np.pi * turns * (pad / 2 + arrival - whole + delay_s * rate_hz))
            for delay_s, gain in delays
        )
        start = whole - pad // 2 + pad
        samples[start : start + block + pad] += level * np.fft.irfft(spectrum * shift, block + pad)
    heard = samples[pad : pad + round(seconds * rate_hz)]
    generator = np.random.default_rng(5)
    return (heard + noise * generator.standard_normal(len(heard))).astype(np.float32)


def audio_of(samples: F32, rate_hz: int = RATE_HZ) -> Audio:
    return Audio(samples[None, :], rate_hz)


def cut(samples: F32, duration_s: float | None = None, rate_hz: int = RATE_HZ) -> Echoes:
    return echo.cut_echoes(audio_of(samples, rate_hz), chirp_at(rate_hz), PARAMETERS, duration_s)


def grid(count: int, first_s: float = 0.03) -> F64:
    return first_s + 0.1 * np.arange(count)


def strongest_delay(trace: F32) -> int:
    """Where in a trace the chirp correlates best (envelope)."""
    return int(np.argmax(np.abs(np.correlate(trace, signal.hilbert(chirp_at().samples)))))


@pytest.mark.parametrize("rate_hz", [44_100, 48_000])
@pytest.mark.parametrize("first_s", [0.0, 1_323 / 44_100, 0.0300074, 0.0905])
def test_the_direct_arrival_is_found_to_the_sample(rate_hz: int, first_s: float) -> None:
    planted_s = grid(24, first_s)
    echoes = cut(stream(planted_s, 2.5, rate_hz=rate_hz), rate_hz=rate_hz)
    assert len(echoes.t_s) >= 23
    npt.assert_allclose(echoes.t_s, planted_s[: len(echoes.t_s)], atol=0.51 / 44_100)
    assert echoes.losses_s.shape == (0, 2)
    assert echoes.rate_hz == 44_100


@pytest.mark.parametrize("level", [3e-4, 0.5])
def test_soft_and_loud_chirps_are_found_alike(level: float) -> None:
    echoes = cut(stream(grid(25), 2.5, level=level, noise=1e-6))
    npt.assert_allclose(echoes.t_s, grid(25), atol=0.51 / 44_100)


@pytest.mark.parametrize("rate_hz", [44_100, 48_000])
def test_an_echo_planted_at_7_3_ms_is_found_there(rate_hz: int) -> None:
    planted = ((DISCARDED_SAMPLES / 44_100 + 0.0073, 0.3),)
    echoes = cut(stream(grid(25), 2.5, rate_hz=rate_hz, echoes=planted), rate_hz=rate_hz)
    found_s = np.array([strongest_delay(trace) for trace in echoes.samples]) / 44_100
    npt.assert_allclose(found_s, 0.0073, atol=1 / 44_100)


def test_a_trace_is_the_stream_485_samples_behind_the_arrival() -> None:
    samples = stream(grid(25), 2.5)
    echoes = cut(samples)
    starts = 1_323 + FRAME * np.arange(25) + 485
    assert echoes.samples.shape == (25, ECHO_SAMPLES)
    npt.assert_array_equal(echoes.samples, [samples[k : k + ECHO_SAMPLES] for k in starts])


def test_a_frame_that_ends_early_gives_no_echo() -> None:
    samples = stream(grid(25), 2.5)
    end = 1_323 + 24 * FRAME + 485 + ECHO_SAMPLES
    assert len(cut(samples[:end]).t_s) == 25
    assert len(cut(samples[: end - 1]).t_s) == 24


@pytest.mark.parametrize("rate_hz", [44_100, 48_000])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_the_channel_that_hears_the_chirps_is_cut_wherever_it_is(rate_hz: int, place: int) -> None:
    """Beside it one that is dead, and one that is loud and hears everything but chirps."""
    samples = stream(grid(25), 2.5, rate_hz=rate_hz)
    noise = 0.2 * np.random.default_rng(0).standard_normal(len(samples))
    rows = np.insert(np.stack([noise, np.zeros_like(noise)]), place, samples, axis=0)
    found = echo.cut_echoes(Audio(rows, rate_hz), chirp_at(rate_hz), PARAMETERS)
    npt.assert_array_equal(found.samples, cut(samples, rate_hz=rate_hz).samples)


@pytest.mark.parametrize("quiet_s", [0.0, 9.0])
def test_of_two_channels_the_clearer_is_cut_though_it_is_softer(quiet_s: float) -> None:
    """Also where most of the sound is silence, as outside a stretch that was chosen."""
    clear = stream(grid(25), 2.5, level=0.05, noise=1e-5)
    hoarse = stream(grid(25), 2.5, level=0.4, noise=0.02)
    rows = np.pad(np.stack([hoarse, clear]), ((0, 0), (round(quiet_s * RATE_HZ), 0)))
    npt.assert_array_equal(echo.best_channel(Audio(rows, RATE_HZ), chirp_at()).samples[0], rows[1])


def test_choosing_a_channel_needs_no_more_memory_for_a_longer_walk() -> None:
    peaks = [_peak_of_choice(seconds) for seconds in (30, 300)]
    row_bytes = 270 * RATE_HZ * 4
    assert peaks[1] - peaks[0] < 1.5 * row_bytes  # the channel that is handed on


def _peak_of_choice(seconds: int) -> int:
    """Bytes, beyond the sound itself."""
    audio = Audio(np.tile(stream(grid(10), 1.0), (2, seconds)), RATE_HZ)
    tracemalloc.start()
    echo.best_channel(audio, chirp_at())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.parametrize(("up", "down"), [(147, 160), (1, 2), (1, 4)])
def test_resampling_block_by_block_is_resampling_at_once(
    up: int, down: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples = np.random.default_rng(1).standard_normal(20_001).astype(np.float32)
    whole = echo.resampled(samples, up, down)
    monkeypatch.setattr(echo.sound, "RESAMPLED_AT_ONCE", 3_000)
    npt.assert_array_equal(echo.resampled(samples, up, down), whole)
    assert len(whole) == -(-20_001 * up // down)


def test_resampling_agrees_with_the_fft_and_is_flat_in_the_band() -> None:
    generator = np.random.default_rng(0)
    spectrum = np.zeros(24_001, dtype=complex)
    band = slice(15_000, 20_001)
    spectrum[band] = np.exp(2j * np.pi * generator.random(5_001))
    second = np.fft.irfft(spectrum)
    second *= 0.5 / np.abs(second).max()
    ours = echo.to_echo_rate(audio_of(np.tile(second, 3).astype(np.float32), 48_000))
    middle = ours[44_100:88_200]
    oracle = signal.resample(second, 44_100)
    gain_db = 20 * np.log10(np.abs(np.fft.rfft(middle)[band]) / np.abs(np.fft.rfft(oracle)[band]))
    assert len(ours) == 3 * 44_100
    assert np.abs(gain_db).max() < 0.2
    npt.assert_allclose(middle, oracle, atol=2e-3 * np.abs(oracle).max())


def test_what_lies_above_the_new_band_is_not_folded_into_it() -> None:
    t_s = np.arange(96_000) / 48_000
    tone = np.sin(2 * np.pi * 23_500 * t_s).astype(np.float32)
    folded = echo.to_echo_rate(audio_of(tone, 48_000))
    assert np.abs(folded[2_000:-2_000]).max() < 1e-3


def test_a_stream_at_its_own_rate_is_left_alone() -> None:
    samples = stream(grid(5), 0.5)
    npt.assert_array_equal(echo.to_echo_rate(audio_of(samples)), samples)


def test_two_overlapping_halves_give_the_echoes_of_the_whole() -> None:
    samples = stream(grid(60), 6.0, noise=1e-4)
    whole, offset = cut(samples), 2 * RATE_HZ + 777
    first, second = cut(samples[: 4 * RATE_HZ + 99]), cut(samples[offset:])
    for part, shift_s in ((first, 0.0), (second, offset / RATE_HZ)):
        rows = np.searchsorted(whole.t_s, part.t_s + shift_s - 1e-6)
        npt.assert_allclose(part.t_s + shift_s, whole.t_s[rows], atol=1e-9)
        npt.assert_array_equal(part.samples, whole.samples[rows])
        # The very last frame of a part may lack the quiet tail that the noise is read from.
    assert first.t_s[-1] > second.t_s[0] + offset / RATE_HZ
    assert len(second.t_s) >= 39


def test_jitter_of_a_millisecond_is_followed() -> None:
    jitter_s = np.random.default_rng(3).integers(-44, 45, 40) / RATE_HZ
    planted_s = grid(40) + jitter_s
    echoes = cut(stream(planted_s, 4.05))
    npt.assert_allclose(echoes.t_s, planted_s, atol=0.6 / RATE_HZ)
    assert len(echoes.losses_s) == 0


@pytest.mark.parametrize(("gain", "direct"), [(1.6, True), (3.5, False)])
def test_an_earlier_peak_of_half_the_height_is_the_direct_one(gain: float, direct: bool) -> None:
    planted_s = grid(25)
    echoes = cut(stream(planted_s, 2.5, echoes=((0.001, gain),), level=0.1))
    wanted_s = planted_s if direct else planted_s + 0.001
    npt.assert_allclose(echoes.t_s, wanted_s, atol=2 / RATE_HZ)


def test_a_jump_by_10_ms_is_recovered_and_recorded() -> None:
    samples, planted_s = stream(grid(40), 4.0), grid(40)
    lost_from = round((planted_s[17] + QUIET_S) * RATE_HZ)
    echoes = cut(np.delete(samples, np.s_[lost_from : lost_from + 441]))
    npt.assert_allclose(echoes.t_s, planted_s, atol=1e-4)
    assert echoes.losses_s.shape == (1, 2)
    npt.assert_allclose(echoes.losses_s, [[planted_s[18], 0.01]], atol=1e-4)


def test_jumps_add_up() -> None:
    samples, planted_s = stream(grid(60), 6.0), grid(60)
    lost_from = [round((planted_s[k] + QUIET_S) * RATE_HZ) for k in (17, 38)]
    rows = np.r_[lost_from[0] : lost_from[0] + 300, lost_from[1] : lost_from[1] + 441]
    echoes = cut(np.delete(samples, rows))
    npt.assert_allclose(echoes.t_s, planted_s, atol=1e-4)
    wanted = [[planted_s[18], 300 / RATE_HZ], [planted_s[39], 0.01]]
    npt.assert_allclose(echoes.losses_s, wanted, atol=1e-4)


def test_half_a_second_of_zeros_is_reported_where_and_how_long() -> None:
    samples, planted_s = stream(grid(40), 4.0), grid(40)
    lost_from = round((planted_s[17] + QUIET_S) * RATE_HZ)
    samples[lost_from : lost_from + RATE_HZ // 2] = 0.0
    echoes = cut(samples, duration_s=4.0)
    npt.assert_allclose(echoes.t_s, np.delete(planted_s, np.s_[18:23]), atol=1e-4)
    assert echoes.losses_s.shape == (1, 2)
    npt.assert_allclose(echoes.losses_s[0], [planted_s[18], 0.5], atol=1e-4)


def test_missing_sound_is_put_back_where_the_phase_jumps() -> None:
    samples, planted_s = stream(grid(60), 6.0), grid(60)
    lost_from = round((planted_s[30] + QUIET_S) * RATE_HZ)
    lost = round(0.53 * RATE_HZ)
    kept = np.delete(samples, np.s_[lost_from : lost_from + lost])
    echoes = cut(kept, duration_s=6.0)
    at = planted_s * RATE_HZ
    survivors_s = planted_s[(at < lost_from) | (at > lost_from + lost)]
    npt.assert_allclose(echoes.t_s, survivors_s, atol=1e-4)
    npt.assert_allclose(echoes.losses_s, [[planted_s[31], 0.53]], atol=1e-4)
    blind = cut(kept)
    npt.assert_allclose(blind.losses_s[:, 1], [0.03], atol=1e-4)
    npt.assert_allclose(blind.t_s[31:], echoes.t_s[31:] - 0.5, atol=1e-9)


@pytest.mark.parametrize("early_s", [0.1, 0.5, 0.9, 7.0])
def test_sound_that_merely_ended_early_keeps_its_times(early_s: float) -> None:
    echoes = cut(stream(grid(25), 2.5), duration_s=2.5 + early_s)
    npt.assert_allclose(echoes.t_s, grid(25), atol=1e-4)
    assert len(echoes.losses_s) == 0


LONG_S = 12.0


def rumble(count: int) -> F32:
    """Room noise below 4 kHz, as ventilation and voices make it."""
    white = np.random.default_rng(9).standard_normal(count)
    sos = signal.butter(4, 4_000, fs=RATE_HZ, output="sos")
    return (5e-3 * signal.sosfilt(sos, white)).astype(np.float32)


@cache
def walk_stream() -> F32:
    """A stream whose echoes change from chirp to chirp, as they do for someone who walks."""
    heard = stream(grid(round(LONG_S * 10)), LONG_S, echoes=(), noise=2e-5)
    generator = np.random.default_rng(8)
    decay = 4e-3 * np.exp(-np.arange(3_500) / 800)
    for start in np.round(grid(round(LONG_S * 10)) * RATE_HZ).astype(int):
        room = decay * generator.standard_normal(len(decay))
        echoes = signal.fftconvolve(room, chirp_at().samples)[: len(heard) - start - 200]
        heard[start + 200 : start + 200 + len(echoes)] += echoes
    return heard


def misplaced(cuts: Sequence[tuple[int, int]], added: F32 | float = 0.0) -> int:
    """Echoes at a wrong time after `cuts` (first sample, count)."""
    kept = np.ones(len(walk_stream()), dtype=bool)
    for first, count in cuts:
        kept[first : first + count] = False
    echoes = cut((walk_stream() + added)[kept], duration_s=LONG_S)
    assert len(echoes.t_s) > 0
    off_s = np.abs((echoes.t_s - 0.03 + 0.05) % 0.1 - 0.05)
    lost = ~kept[np.clip(np.round(echoes.t_s * RATE_HZ).astype(int) + 300, 0, len(kept) - 1)]
    return int(np.sum((off_s > 1e-3) | lost))


def random_cuts(seed: int, *counts: int) -> list[tuple[int, int]]:
    """Stretches to cut, far apart and away from the ends."""
    generator = np.random.default_rng(seed)
    room = round(LONG_S * RATE_HZ) // len(counts)
    return [
        (k * room + int(generator.integers(RATE_HZ // 2, room - RATE_HZ - count // 2)), count)
        for k, count in enumerate(counts)
    ]


SPLIT = 1
"""The one chirp that a cut goes through may be taken for lost or for kept."""


@pytest.mark.parametrize("lost_s", [0.5, 5.0])
def test_behind_a_click_that_may_have_lost_whole_periods_nothing_is_timed(lost_s: float) -> None:
    cuts = [random_cuts(seed, round(lost_s * RATE_HZ)) for seed in range(12)]
    wrong = [misplaced(each) for each in cuts]
    assert sum(each <= SPLIT for each in wrong) >= 11  # one through the direct chirp is not heard


@pytest.mark.parametrize("lost", [RATE_HZ // 2, RATE_HZ // 2 + 40, round(0.53 * RATE_HZ)])
def test_sound_lost_at_the_end_is_merely_missing(lost: int) -> None:
    assert misplaced([(len(walk_stream()) - lost, lost)]) == 0


@pytest.mark.parametrize("seed", range(12))
def test_one_loss_is_put_back_where_the_stream_broke(seed: int) -> None:
    count = int(np.random.default_rng(seed).integers(1_000, 3_500)) + 4_410 * (seed % 8)
    assert misplaced(random_cuts(seed, count)) <= SPLIT


@pytest.mark.parametrize("seed", range(12))
def test_a_loss_of_nearly_whole_periods_shows_as_a_lasting_step(seed: int) -> None:
    count = RATE_HZ // 2 + (-1) ** seed * (12 + 6 * seed)
    assert misplaced(random_cuts(seed, count)) <= SPLIT


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(
    "lost_s", [(0.5, 0.5), (0.37, 0.43), (0.53, 0.31), (0.501, 0.53), (0.43, 0.36, 0.55)]
)
def test_several_losses_are_never_merged_into_one(seed: int, lost_s: tuple[float, ...]) -> None:
    assert misplaced(random_cuts(seed, *(round(s * RATE_HZ) for s in lost_s))) <= SPLIT


@pytest.mark.parametrize("lost_s", [(0.5, 0.53), (0.37, 0.5)])
def test_whole_periods_lost_beside_another_loss_click(lost_s: tuple[float, ...]) -> None:
    added = rumble(len(walk_stream()))
    cuts = [random_cuts(seed, *(round(s * RATE_HZ) for s in lost_s)) for seed in range(12)]
    wrong = [misplaced(both, added) for both in cuts]
    assert sum(each <= SPLIT for each in wrong) >= 11  # one through the direct chirp is not heard
    placed = [misplaced([both[lost_s.index(0.5) - 1]], added) for both in cuts]
    assert max(placed) <= SPLIT


def test_several_losses_below_a_period_are_each_put_back() -> None:
    assert misplaced(random_cuts(3, 1_300, 2_700, 900)) <= 3 * SPLIT


def test_motion_that_ended_early_cannot_measure_a_loss() -> None:
    """What was heard before the break is certain, and nothing behind it."""
    lost_from = 99_000
    kept = np.delete(walk_stream(), np.s_[lost_from : lost_from + round(0.53 * RATE_HZ)])
    echoes = cut(kept, duration_s=len(kept) / RATE_HZ - 1.0)
    npt.assert_allclose(echoes.t_s, grid(len(echoes.t_s)), atol=1e-3)
    assert 0 < lost_from / RATE_HZ - echoes.t_s[-1] < 0.2
    assert len(cut(stream(grid(40), 4.0), duration_s=3.0).t_s) == 40


def test_a_break_right_at_the_beginning_leaves_nothing_to_time() -> None:
    first = int(np.round((grid(1)[0] + 0.08) * RATE_HZ))
    kept = np.delete(walk_stream(), np.s_[first : first + round(0.53 * RATE_HZ)])
    assert len(cut(kept, duration_s=len(kept) / RATE_HZ - 2.0).t_s) == 1


def test_silence_after_a_jump_is_reported_on_the_recordings_clock() -> None:
    samples, planted_s = stream(grid(60), 6.0), grid(60)
    silent_from = round((planted_s[40] + QUIET_S) * RATE_HZ)
    samples[silent_from : silent_from + RATE_HZ // 5] = 0.0
    jump_at = round((planted_s[10] + QUIET_S) * RATE_HZ)
    echoes = cut(np.delete(samples, np.s_[jump_at : jump_at + 2_205]))
    npt.assert_allclose(echoes.losses_s, [[planted_s[11], 0.05], [planted_s[41], 0.2]], atol=1e-4)


def test_silence_before_the_first_chirp_is_no_loss_and_shifts_nothing() -> None:
    planted_s = grid(40, first_s=0.537)
    echoes = cut(stream(planted_s, 4.5))
    npt.assert_allclose(echoes.t_s, planted_s[: len(echoes.t_s)], atol=1e-4)
    assert len(echoes.t_s) >= 39
    assert len(echoes.losses_s) == 0


def test_an_arrival_with_nothing_but_zeros_behind_it_gives_no_echo() -> None:
    samples, planted_s = stream(grid(40), 4.0), grid(40)
    broken = round((planted_s[17] + 0.0105) * RATE_HZ)
    samples[broken : broken + RATE_HZ // 10 - 500] = 0.0
    echoes = cut(samples)
    npt.assert_allclose(echoes.t_s, np.delete(planted_s, 17), atol=1e-4)
    assert echoes.samples.any(axis=1).all()


def test_sound_that_is_too_short_is_refused() -> None:
    with pytest.raises(InputError, match=r"wanted at least 2 s, got 1.90 s; record longer"):
        cut(stream(grid(19), 1.9))
    patient = dataclasses.replace(PARAMETERS, minimum_duration_s=1.0)
    assert len(echo.cut_echoes(audio_of(stream(grid(19), 1.9)), chirp_at(), patient).t_s) == 19


def test_silence_is_refused() -> None:
    with pytest.raises(InputError, match="audio: it is silent; check that the microphone"):
        cut(np.zeros(3 * RATE_HZ, dtype=np.float32))


def test_clipped_sound_is_refused_with_its_share() -> None:
    clipped = np.clip(stream(grid(30), 3.0, level=2.0), -1, 1)
    share = np.mean(np.abs(clipped) >= 0.999)
    with pytest.raises(InputError, match=rf"{share:.1%} of the samples are clipped; lower the vol"):
        cut(clipped)


def test_noise_without_chirps_is_refused() -> None:
    noise = 0.1 * np.random.default_rng(2).standard_normal(4 * RATE_HZ)
    with pytest.raises(InputError, match="no chirps in the 15-20 kHz band; turn echo cancellation"):
        cut(noise.astype(np.float32))


def test_a_recording_that_mostly_lacks_chirps_is_refused_with_the_count() -> None:
    strong = dataclasses.replace(PARAMETERS, found_share=0.9)
    samples = stream(grid(25), 3.0)
    with pytest.raises(InputError, match=r"chirps in 25 of 30 frames, wanted 90%; check that"):
        echo.cut_echoes(audio_of(samples), chirp_at(), strong)
    assert len(cut(samples).t_s) == 25


@pytest.mark.parametrize("rate_hz", [32_000, 96_000])
def test_sound_at_another_rate_is_refused(rate_hz: int) -> None:
    audio = audio_of(stream(grid(30), 3.0), rate_hz)
    with pytest.raises(InputError, match=rf"wanted 44100 or 48000 Hz, got {rate_hz}; record again"):
        echo.to_echo_rate(audio)


def test_phones_that_play_and_record_at_different_rates_get_on() -> None:
    samples = stream(grid(25), 2.5)
    other = echo.cut_echoes(audio_of(samples), chirp_at(48_000), PARAMETERS)
    npt.assert_array_equal(other.t_s, cut(samples).t_s)


def test_a_playback_that_falls_behind_is_a_break_and_no_loss() -> None:
    period = round(0.1 * 44_100)
    arrivals = 500 + period * np.arange(40) + np.where(np.arange(40) >= 20, 441, 0)
    chirp = make_chirp(ChirpParameters(), 44_100)
    samples = np.zeros(period * 42, dtype=np.float32)
    samples += 1e-5 * np.random.default_rng(0).standard_normal(len(samples)).astype(np.float32)
    for arrival in arrivals:
        samples[arrival : arrival + len(chirp.samples)] += 0.3 * chirp.samples
    duration_s = len(samples) / 44_100
    echoes = echo.cut_echoes(Audio(samples[None], 44_100), chirp, echo.EchoParameters(), duration_s)
    assert echoes.losses_s.shape == (1, 2)
    assert echoes.losses_s[0, 1] == 0.0
    np.testing.assert_allclose(echoes.t_s, arrivals / 44_100, atol=1e-4)


@pytest.mark.parametrize("reach", [{"slack_s": 0.2}, {"early_s": 0.2}])
def test_a_search_wider_than_half_a_period_is_refused(reach: dict[str, float]) -> None:
    wide = dataclasses.replace(PARAMETERS, **reach)
    with pytest.raises(ParameterError, match=r"wanted less than half of chirp.period_s, 0.05 s, g"):
        echo.cut_echoes(audio_of(stream(grid(25), 2.5)), chirp_at(), wide)


@pytest.mark.parametrize("reach", [{"slack_s": 0.02}, {"early_s": 0.02}])
def test_the_widest_search_still_finds_every_chirp(reach: dict[str, float]) -> None:
    wide = dataclasses.replace(PARAMETERS, **reach)
    echoes = echo.cut_echoes(audio_of(stream(grid(25), 2.5)), chirp_at(), wide)
    npt.assert_allclose(echoes.t_s, grid(25), atol=1e-4)


@pytest.mark.parametrize(("period_s", "beat"), [(0.2, "100.0"), (0.3, "[12]00.0"), (0.15, ".*")])
def test_a_period_that_is_not_the_sounds_is_refused(period_s: float, beat: str) -> None:
    slow = make_chirp(ChirpParameters(period_s=period_s), RATE_HZ)
    with pytest.raises(InputError, match=rf"chirps come every {beat} ms, not at the period"):
        echo.cut_echoes(audio_of(stream(grid(60), 6.0)), slow, PARAMETERS)


def test_chirps_at_half_the_beat_are_refused() -> None:
    lenient = dataclasses.replace(PARAMETERS, found_share=0.1)
    with pytest.raises(InputError, match=r"chirps come every 200.0 ms, not at the period"):
        echo.cut_echoes(audio_of(stream(grid(60)[::2], 6.0)), chirp_at(), lenient)


def test_sound_of_less_than_two_periods_is_refused() -> None:
    slow = make_chirp(ChirpParameters(period_s=1.0), RATE_HZ)
    patient = dataclasses.replace(PARAMETERS, minimum_duration_s=0.5)
    with pytest.raises(InputError, match=r"wanted at least two periods of 1 s, got 1.90 s; record"):
        echo.cut_echoes(audio_of(stream(grid(19), 1.9)), slow, patient)


def test_sound_that_ends_before_its_only_echo_is_refused() -> None:
    patient = dataclasses.replace(PARAMETERS, minimum_duration_s=0.2, found_share=0.0)
    samples = stream([0.19], 0.21)
    with pytest.raises(InputError, match=r"it ends before the first echo does; record longer"):
        echo.cut_echoes(audio_of(samples), chirp_at(), patient)


def test_a_long_stream_is_filtered_by_blocks_as_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = np.random.default_rng(5).normal(size=20_000).astype(np.float32)
    chirp = chirp_at()
    whole = echo.sound.matched_envelope(samples, chirp)
    monkeypatch.setattr(echo.sound, "FILTERED_AT_ONCE", 777)
    blocks = echo.sound.matched_envelope(samples, chirp)
    npt.assert_allclose(blocks, whole, atol=1e-5 * float(whole.max()))


def test_a_real_phone_with_its_own_chirp_is_followed_through_slips(shared_data: Path) -> None:
    """An iPhone that plays a linear chirp of its own every 200 ms; its stream slips and returns."""
    folder = shared_data / "phones"
    played, rate_hz = soundfile.read(folder / "iphone_ranging_played.wav", dtype="float32")
    recorded, _ = soundfile.read(folder / "iphone_ranging.wav", dtype="float32", always_2d=True)
    chirp = Chirp(played[: rate_hz // 10], rate_hz, 0.2, np.array([10_000.0, 20_000.0]))
    parameters = dataclasses.replace(PARAMETERS, minimum_duration_s=1.0)
    frames = find_frames(Audio(recorded.T, rate_hz), chirp, parameters)
    late = np.diff(frames.arrivals.samples) - round(0.2 * RATE_HZ)
    slipped = np.abs(late) > 2
    assert len(frames.arrivals.samples) >= 0.98 * len(recorded) / (0.2 * rate_hz)
    assert 0.2 < slipped.mean() < 0.6
    assert (np.abs(np.abs(late[slipped]) - 10) <= 2).all()
    assert abs(late.sum()) <= 12


def noisy_stream(over_db: float) -> F32:
    """Chirps with a Gaussian tail from 8 to 30 ms behind them, so far over noise (compressed)."""
    generator, chirp = np.random.default_rng(8), chirp_at().samples
    response = np.zeros(FRAME)
    response[0], response[353:1323] = 1.0, 0.02 * generator.standard_normal(970)
    power = np.abs(np.fft.rfft(chirp, 8192)) ** 2
    noise = 0.02 * np.sqrt(np.sum(power**2) / np.sum(power) / 10 ** (over_db / 10))
    heard = signal.fftconvolve(np.tile(response, 60), chirp)
    return (0.2 * (heard + noise * generator.standard_normal(len(heard)))).astype(np.float32)


@pytest.mark.parametrize("over_db", [-6.0, 0.0, 9.0, 20.0])
def test_echoes_are_as_far_over_the_noise_as_planted(over_db: float) -> None:
    assert cut(noisy_stream(over_db)).over_noise_db == pytest.approx(over_db, abs=1.5)


@pytest.mark.parametrize(("over_db", "low_db", "high_db"), [(-6, -7, -4), (0, -1, 3), (9, 8, 40)])
def test_frames_tell_of_much_noise_and_are_not_blamed_for_little(
    over_db: float, low_db: float, high_db: float
) -> None:
    """Phones keep frames, from 5 ms before the direct sound to 75 ms after it."""
    samples = noisy_stream(over_db)
    at = (np.arange(len(samples)) + 220) % FRAME
    assert low_db < cut(samples * (at < 220 + 3308)).over_noise_db < high_db
