"""Sound on disk; cut-off files are refused in test_recordings."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from elfslam.base.errors import InputError
from elfslam.base.values import Audio
from elfslam.data.audio_files import at_accepted_rate, read_audio, read_recorded_sound, write_audio

RATE_HZ = 44_100


@settings(max_examples=30, deadline=None)
@given(
    samples=arrays(
        np.float32,
        st.tuples(st.integers(1, 3), st.integers(1, 300)),
        elements=st.floats(-1, 1, width=32),
    )
)
def test_flac_keeps_24_bits(tmp_path_factory: pytest.TempPathFactory, samples: np.ndarray) -> None:
    file = tmp_path_factory.mktemp("sound") / "audio.flac"
    write_audio(Audio(samples, RATE_HZ), file)
    np.testing.assert_allclose(read_audio(file).samples, samples, atol=1.3e-7)


@contextmanager
def room_for(size_bytes: int) -> Iterator[None]:
    """As on a disk where no file may become larger than that."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_sound_that_does_not_fit_is_an_error_wherever_it_ends(tmp_path: Path) -> None:
    """The last bytes as well: the library itself is silent about those."""
    noise = np.random.default_rng(0).uniform(-0.1, 0.1, (1, 3000)).astype(np.float32)
    sound, file = Audio(noise, RATE_HZ), tmp_path / "audio.flac"
    write_audio(sound, file)
    size_bytes = file.stat().st_size
    for short in (1, 2, 100, 3000, size_bytes - 42, size_bytes):
        with room_for(size_bytes - short), pytest.raises(OSError, match="too large"):
            write_audio(sound, file)
    with room_for(size_bytes):
        write_audio(sound, file)
    np.testing.assert_allclose(read_audio(file).samples, noise, atol=1.3e-7)


def write_frames(
    folder: Path, frames: np.ndarray, t_s: list[float], name: str = "frames.flac"
) -> None:
    soundfile.write(folder / name, frames.reshape(-1), RATE_HZ, subtype="PCM_24")
    (folder / "frames.csv").write_text("t_s\n" + "".join(f"{t:.9f}\n" for t in t_s))


@pytest.mark.parametrize("name", ["frames.flac", "frames.wav"])
def test_frames_lie_at_their_times_on_silence(tmp_path: Path, name: str) -> None:
    frames = np.random.default_rng(0).uniform(-1, 1, (3, 3528))
    write_frames(tmp_path, frames, [0.0, 0.1, 0.35], name)
    samples = read_recorded_sound(tmp_path).samples
    assert samples.shape == (1, 15_435 + 3528)
    for start, frame in zip((0, 4410, 15_435), frames, strict=True):
        np.testing.assert_allclose(samples[0, start : start + 3528], frame, atol=1e-6)
    assert not samples[0, 3528:4410].any()
    assert not samples[0, 7938:15_435].any()


@pytest.mark.parametrize(
    ("t_s", "says"),
    [
        ([0.0, 0.1], "not 2 equal frames"),
        ([-0.1, 0.1, 0.2], "at times from 0 on"),
        ([0.0, 100.0, 200.0], "wanted seconds"),
        ([0.0, 0.2, 0.1], "runs backward at row 4"),
        ([0.0, 0.1, 1e4], r"frames\.csv: its length claims"),
        ([0.0, 0.1, 1e300], r"frames\.csv: its length claims"),
    ],
)
def test_frames_that_do_not_fit_are_refused(tmp_path: Path, t_s: list[float], says: str) -> None:
    write_frames(tmp_path, np.zeros((3, 3529)), t_s)
    with pytest.raises(InputError, match=says):
        read_recorded_sound(tmp_path)


def with_length(flac: bytes, samples: int) -> bytes:
    """The same sound, whose header says that it is so long (36 bits, from byte 21.5 on)."""
    first = (flac[21] & 0xF0) | samples >> 32
    return flac[:21] + bytes([first]) + (samples & 0xFFFFFFFF).to_bytes(4, "big") + flac[26:]


@pytest.mark.parametrize("samples", [0, 2**36 - 1])
def test_a_length_that_no_file_of_that_size_has_is_refused(tmp_path: Path, samples: int) -> None:
    file = tmp_path / "audio.flac"
    write_audio(Audio(np.zeros((1, 44_100)), RATE_HZ), file)
    file.write_bytes(with_length(file.read_bytes(), samples))
    with pytest.raises(InputError, match="its length claims"):
        read_audio(file)
    file.write_bytes(with_length(file.read_bytes(), 44_101))
    with pytest.raises(InputError, match=r"cannot be read|is cut off"):
        read_audio(file)


def test_sound_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "audio.wav"
    soundfile.write(file, np.array([0.0, np.nan]), RATE_HZ, subtype="FLOAT")
    with pytest.raises(InputError, match="not finite"):
        read_audio(file)


def test_a_folder_without_sound_has_none(tmp_path: Path) -> None:
    assert read_recorded_sound(tmp_path) is None


@pytest.mark.parametrize("bits", [16, 24, 32])
def test_floats_in_the_scale_of_whole_numbers_are_divided_aloud(tmp_path: Path, bits: int) -> None:
    noise = np.random.default_rng(0).uniform(-0.9, 0.9, (900, 2))
    file, scale = tmp_path / "audio.wav", 2 ** (bits - 1)
    soundfile.write(file, noise * scale, RATE_HZ, subtype="FLOAT")
    audio = read_audio(file)
    np.testing.assert_allclose(audio.samples, noise.T, atol=1e-6)
    (note,) = audio.notes
    assert note.endswith(f"it was divided by {scale}")


@pytest.mark.parametrize("peak", [0.5, 7.9])
def test_floats_about_full_scale_are_left_as_they_are(tmp_path: Path, peak: float) -> None:
    file = tmp_path / "audio.wav"
    soundfile.write(file, np.array([0.1, -peak]), RATE_HZ, subtype="FLOAT")
    audio = read_audio(file)
    np.testing.assert_allclose(audio.samples, [[0.1, -peak]], rtol=1e-6)
    assert audio.notes == ()


@pytest.mark.parametrize(
    ("rate_hz", "wanted_hz"),
    [(88_200, 44_100), (96_000, 48_000), (176_400, 44_100), (192_000, 48_000), (44_100, 44_100)],
)
def test_multiples_of_the_rates_are_resampled_true_in_band(rate_hz: int, wanted_hz: int) -> None:
    def tones(at_hz: int) -> np.ndarray:
        t_s = np.arange(at_hz // 5) / at_hz
        return np.array([np.sin(2 * np.pi * hz * t_s) for hz in (15_000, 20_000)])

    audio = at_accepted_rate(Audio(tones(rate_hz), rate_hz, notes=("before",)))
    assert audio.rate_hz == wanted_hz
    inside = slice(500, -500)
    np.testing.assert_allclose(audio.samples[:, inside], tones(wanted_hz)[:, inside], atol=2e-3)
    wanted = f"the sound was resampled from {rate_hz} to {wanted_hz} Hz"
    assert audio.notes[1:] == (() if rate_hz == wanted_hz else (wanted,))


def test_any_other_rate_is_left_to_be_refused_where_chirps_are_looked_for() -> None:
    audio = Audio(np.zeros((1, 100)), 32_000)
    assert at_accepted_rate(audio) is audio
