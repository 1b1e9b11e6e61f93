"""The chirp band alone: what goes in comes out, at the same moment."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Recording
from elfslam.data import baseband as module
from elfslam.data.audio_files import read_recorded_sound
from elfslam.data.recordings import read_recording, write_recording
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import EchoParameters, cut_echoes

RATES_HZ = (44_100, 48_000)
LATENCY_S = 0.0437


def heard(rate_hz: int, *, chirps: int = 25, latency_s: float = LATENCY_S) -> Audio:
    """Chirps with a direct path and decaying echoes, other ones each time, over a little noise."""
    generator = np.random.default_rng(5)
    chirp = make_chirp(ChirpParameters(), rate_hz).samples.astype(np.float64)
    period, latency = rate_hz // 10, round(latency_s * rate_hz)
    samples = 1e-6 * generator.standard_normal(chirps * period + rate_hz // 5)
    for k in range(chirps):
        room = np.zeros(round(0.08 * rate_hz))
        delays_s = generator.uniform(0.003, 0.08, 120)
        gains = 0.03 * generator.uniform(-1, 1, 120) * np.exp(-delays_s / 0.02)
        np.add.at(room, (delays_s * rate_hz).astype(int), gains)
        room[0] = 0.5
        played = np.convolve(chirp, room)
        start = latency + k * period
        samples[start : start + len(played)] += played
    return Audio(samples[None].astype(np.float32), rate_hz)


def sent(audio: Audio) -> Audio:
    """The sound after the way through the baseband."""
    chirp = make_chirp(ChirpParameters(), audio.rate_hz)
    return module.from_baseband(module.to_baseband(audio, module.frame_starts_s(audio, chirp)))


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_echoes_come_back_at_the_same_sample_55_db_above_the_difference(rate_hz: int) -> None:
    audio = heard(rate_hz)
    chirp = make_chirp(ChirpParameters(), rate_hz)
    whole = cut_echoes(audio, chirp, EchoParameters())
    small = cut_echoes(sent(audio), chirp, EchoParameters())
    np.testing.assert_array_equal(small.t_s, whole.t_s[: len(small.t_s)])
    assert len(small.t_s) >= 24
    kept = slice(0, len(small.t_s))
    spectrum = np.fft.rfft(whole.samples[kept] * np.hanning(2352))
    off = spectrum - np.fft.rfft(small.samples * np.hanning(2352))
    hz = np.fft.rfftfreq(2352, 1 / 44_100)
    band = (hz >= 15_000) & (hz <= 20_000)
    power, error = ((np.abs(part[:, band]) ** 2).sum(axis=1) for part in (spectrum, off))
    assert (10 * np.log10(power / error)).min() > 55


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_it_is_the_analytic_signal_shifted_down(rate_hz: int) -> None:
    t_s = np.arange(rate_hz) / rate_hz
    tone = 0.5 * np.cos(2 * np.pi * 16_250 * t_s + 0.3)
    made = module.to_baseband(Audio(tone[None], rate_hz), np.array([0.2, 0.31]))
    assert made.first.tolist() == [1260, 1953]
    values = (made.iq[..., 0] + 1j * made.iq[..., 1]) * made.scale[:, None]
    grid_s = made.t_s[:, None] + np.arange(504) / 6300
    wanted = 0.5 * np.exp(1j * (2 * np.pi * (16_250 - 17_500) * grid_s + 0.3))
    np.testing.assert_allclose(values, wanted, atol=1e-4)


def test_blocks_are_seamless(monkeypatch: pytest.MonkeyPatch) -> None:
    audio, starts_s = heard(48_000), LATENCY_S + np.arange(20) * 0.1
    whole = module.to_baseband(audio, starts_s)
    sound = module.from_baseband(whole)
    monkeypatch.setattr(module, "BLOCK", 1000)
    np.testing.assert_allclose(module.to_baseband(audio, starts_s).iq, whole.iq, atol=1)
    np.testing.assert_allclose(module.from_baseband(whole).samples, sound.samples, atol=1e-6)


def test_frames_begin_in_the_recording_and_end_in_it() -> None:
    made = module.to_baseband(heard(48_000, chirps=3), np.array([-0.003, 0.1, 0.4, 0.45]))
    np.testing.assert_allclose(made.t_s, [0.0, 0.1, 0.4], atol=1e-4)
    with pytest.raises(InputError, match="holds no whole frame"):
        module.to_baseband(heard(48_000, chirps=3), np.array([5.0]))


def test_a_given_scale_clips_and_does_not_wrap() -> None:
    audio = heard(48_000)
    made = module.to_baseband(audio, np.array([LATENCY_S]), scale=1e-6)
    assert made.scale.tolist() == [1e-6]
    assert np.abs(made.iq.astype(int)).max() == 32_767
    honest = module.to_baseband(audio, np.array([LATENCY_S])).iq
    loud = np.abs(honest.astype(int)) > 16_000
    assert (np.sign(made.iq[loud]) == np.sign(honest[loud])).all()


def test_silence_is_kept_as_silence() -> None:
    made = module.to_baseband(Audio(np.zeros((1, 48_000)), 48_000), np.array([0.1]))
    assert not made.iq.any()
    assert not module.from_baseband(made).samples.any()


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_files_give_back_what_was_written(tmp_path: Path, rate_hz: int) -> None:
    made = module.to_baseband(heard(rate_hz), LATENCY_S + np.arange(20) * 0.1)
    again = module.read_baseband(tmp_path, module.write_baseband(made, tmp_path))
    assert again.kept == made.kept
    np.testing.assert_array_equal(again.first, made.first)
    np.testing.assert_array_equal(again.iq, made.iq)
    np.testing.assert_allclose(again.scale, made.scale, rtol=0)


def test_each_frame_has_the_least_scale_that_clips_nothing() -> None:
    audio = heard(48_000)
    fading = Audio(audio.samples * np.linspace(1, 0.01, audio.samples.shape[1]), 48_000)
    made = module.to_baseband(fading, LATENCY_S - 0.005 + np.arange(20) * 0.1)
    np.testing.assert_array_equal(np.abs(made.iq.astype(int)).max(axis=(1, 2)), 32_767)
    assert made.scale[0] / made.scale[-1] > 3
    assert np.diff(made.scale).max() < 0


def test_walks_recorded_with_one_scale_for_all_are_read(tmp_path: Path) -> None:
    made = module.to_baseband(heard(48_000), LATENCY_S + np.arange(20) * 0.1, scale=2e-5)
    described = module.write_baseband(made, tmp_path)
    rows = (tmp_path / "baseband.csv").read_text().splitlines()
    assert rows[0] == "t_s,scale"
    before = "".join(f"{row.split(',')[0]}\n" for row in rows)
    (tmp_path / "baseband.csv").write_text(before)
    again = module.read_baseband(tmp_path, {**described, "scale": 2e-5})
    np.testing.assert_allclose(again.scale, np.full(20, 2e-5))
    one, other = (module.from_baseband(each).samples for each in (again, made))
    np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("scale", ["0", "-1e-5", "2", "nan"])
def test_a_scale_beyond_belief_is_refused(tmp_path: Path, scale: str) -> None:
    described = folder_of(tmp_path)
    file = tmp_path / "baseband.csv"
    rows = file.read_text().splitlines()
    rows[2] = f"{rows[2].split(',')[0]},{scale}"
    file.write_text("\n".join(rows) + "\n")
    with pytest.raises(InputError, match=r"baseband\.csv: row 3 has .* wanted"):
        module.read_baseband(tmp_path, described)


def loud_speech(rate_hz: int) -> F64:
    """Tones at full scale all over the band of speech."""
    t_s = np.arange(rate_hz) / rate_hz
    tones = [np.cos(2 * np.pi * hz * t_s + hz) for hz in range(150, 8000, 317)]
    return np.asarray(np.sum(tones, axis=0) / 5)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_speech_leaves_nothing_in_what_is_kept(rate_hz: int) -> None:
    """Not even 16 bits of a silent room's own noise would show it: 130 dB."""
    audio = Audio(loud_speech(rate_hz)[None], rate_hz)
    made = module.to_baseband(audio, np.array([0.1, 0.3, 0.5]))
    assert np.abs(made.iq * made.scale[:, None, None]).max() < 10 ** (-130 / 20)
    inner = module.in_band(audio).samples[0, 1000:-1000]
    assert np.abs(inner).max() < 10 ** (-130 / 20)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_the_band_as_sound_is_neither_delayed_nor_changed(rate_hz: int) -> None:
    audio = heard(rate_hz)
    spectrum = np.fft.rfft(audio.samples[0])
    off = spectrum - np.fft.rfft(module.in_band(audio).samples[0])
    hz = np.fft.rfftfreq(audio.samples.shape[1], 1 / rate_hz)
    band = (hz >= 15_000) & (hz <= 20_000)
    power, error = ((np.abs(part[band]) ** 2).sum() for part in (spectrum, off))
    assert 10 * np.log10(power / error) > 80


def test_a_recording_is_sent_small_and_read_like_any_other(tmp_path: Path) -> None:
    audio = heard(48_000)
    small = module.to_baseband(audio, LATENCY_S - 0.005 + np.arange(20) * 0.1)
    recording = Recording(name="walk", device="phone", audio=audio)
    write_recording(recording, tmp_path / "walk", baseband=small)
    assert not (tmp_path / "walk" / "audio.flac").exists()
    again = read_recording(tmp_path / "walk")
    np.testing.assert_array_equal(again.audio.samples, module.from_baseband(small).samples)
    assert again.audio.rate_hz == 48_000
    (tmp_path / "walk" / "baseband.iq").unlink()
    with pytest.raises(InputError, match="promises audio and none is there"):
        read_recording(tmp_path / "walk")


def folder_of(tmp_path: Path) -> dict[str, Any]:
    made = module.to_baseband(heard(48_000, chirps=5), LATENCY_S + np.arange(4) * 0.1)
    return module.write_baseband(made, tmp_path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda iq, rows: (iq[:-1], rows), r"has 8063 bytes, wanted 8064 for 4 frames"),
        (lambda iq, rows: (iq, rows[:-1]), r"has 8064 bytes, wanted 6048 for 3 frames"),
        (lambda iq, rows: (iq, ["0.010050000", *rows[1:]]), r"row 2 has 0.010050000 s, wanted a"),
        (lambda iq, rows: (iq, ["nan", *rows[1:]]), "row 2 has 'nan', wanted a finite number"),
        (lambda iq, rows: (iq, [*rows[:-1], "1000000000"]), "wanted seconds from 0 on"),
        (lambda iq, rows: (iq, [rows[1], rows[0], *rows[2:]]), "runs backward at row 3"),
        (lambda iq, rows: (iq, []), "has a header and no rows"),
    ],
)
def test_damaged_files_are_refused(
    tmp_path: Path, change: Callable[[bytes, list[str]], tuple[bytes, list[str]]], says: str
) -> None:
    described = folder_of(tmp_path)
    iq, rows = tmp_path / "baseband.iq", tmp_path / "baseband.csv"
    content, lines = change(iq.read_bytes(), rows.read_text().splitlines()[1:])
    iq.write_bytes(content)
    rows.write_text("\n".join(["t_s", *lines]) + "\n")
    with pytest.raises(InputError, match=says):
        module.read_baseband(tmp_path, described)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("rate_hz", 1e12),
        ("rate_hz", 6300.5),
        ("rate_hz", "6300"),
        ("frame_samples", -504),
        ("frame_samples", 10**9),
        ("scale", float("nan")),
        ("source_rate_hz", 192_000),
        ("centre_hz", -17_500),
        ("lead_s", -1),
    ],
)
def test_what_a_manifest_cannot_mean_is_refused(tmp_path: Path, name: str, given: object) -> None:
    described = folder_of(tmp_path)
    with pytest.raises(InputError, match=rf"recording\.json: baseband\.{name} is"):
        module.read_baseband(tmp_path, {**described, name: given})


@pytest.mark.parametrize("described", [None, [], 3, "flac"])
def test_a_baseband_that_is_not_described_is_refused(tmp_path: Path, described: object) -> None:
    folder_of(tmp_path)
    with pytest.raises(InputError, match=r"wanted how baseband\.iq was made"):
        read_recorded_sound(tmp_path, described)


def test_the_format_is_that_of_the_phone_page() -> None:
    said = json.loads(json.dumps(asdict(module.BasebandFormat(scale=2e-5))))
    assert said == {
        "rate_hz": 6300,
        "centre_hz": 17_500,
        "frame_samples": 504,
        "scale": 2e-5,
        "source_rate_hz": 48_000,
        "lead_s": 0.005,
    }
