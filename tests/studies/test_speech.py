"""The study of what is left of speech: on sounds like speech, and on voices where they are."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import soundfile

from elfslam.base.errors import InputError
from elfslam.world.interference import speech_like
from studies import eavesdropping, speech
from studies import speech as study
from studies.eavesdropping import OUT_HZ, as_sent, enhanced, line_of, shifted
from studies.results import Record
from studies.study import StudyContext

pytest.importorskip("pystoi", reason="pystoi is not installed")
SECONDS = 1.6


def spoken(seed: int, rate_hz: int = speech.RATE_HZ) -> np.ndarray:
    """Syllables that nobody said."""
    count = round(SECONDS * rate_hz)
    return np.asarray(speech_like(count, rate_hz, np.random.default_rng(seed), 0.1), float)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    (folder / "speech").mkdir()
    for seed in (1, 2):
        soundfile.write(folder / "speech" / f"{seed}.wav", spoken(seed), speech.RATE_HZ)
    return folder


@pytest.fixture(scope="module")
def records(data: Path) -> list[Record]:
    with pytest.MonkeyPatch.context() as only_own:
        only_own.setattr(study, "WORDS", data / "none")
        only_own.setattr(study, "SENTENCES", data / "none")
        only_own.setattr(shutil, "which", lambda name: None)
        only_own.setattr(eavesdropping, "PLACES_HZ", (0, 1000))
        return speech.measure_speech(StudyContext(data), levels_dbfs=(-40.0,))


def stoi_of(records: list[Record], method: str, condition: str) -> float:
    wanted = (method, condition, "STOI")
    (found,) = [r for r in records if (r.method, r.condition, r.metric) == wanted]
    assert found.low is not None
    assert found.high is not None
    assert found.low <= found.value <= found.high
    return found.value


def test_speech_is_understood_before_and_not_after(records: list[Record]) -> None:
    for chirps in (True, False):
        how = str(speech.Circumstance(-40.0, chirps))
        before = stoi_of(records, speech.BEFORE, how)
        for what in ("as sent", "shifted down", "envelope"):
            for form in (what, f"{what}, enhanced"):
                assert stoi_of(records, form, how) < 0.5 * before, form
    assert before > 0.7


def test_speech_that_lies_in_the_band_is_found_there(records: list[Record]) -> None:
    """So a low figure is no fault of the ways to listen."""
    found = stoi_of(records, "shifted down", speech.MOVED)
    assert found > 0.6
    soft = str(speech.Circumstance(-40.0, chirps=False))
    assert found > 2 * stoi_of(records, "shifted down", soft)


def test_without_speech_it_says_what_lacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "WORDS", tmp_path)
    with pytest.raises(InputError, match=r"install alsa-utils and espeak-ng.*speech"):
        speech.measure_speech(StudyContext(tmp_path))


@pytest.mark.parametrize("samples", [np.zeros(48_000), np.ones(100)])
def test_what_is_no_speech_is_refused(tmp_path: Path, samples: np.ndarray) -> None:
    (tmp_path / "speech").mkdir()
    soundfile.write(tmp_path / "speech" / "x.wav", samples, speech.RATE_HZ)
    with pytest.raises(InputError, match=r"x\.wav: has .* wanted a sentence"):
        speech.utterances(tmp_path)


def test_what_is_no_sound_is_refused(tmp_path: Path) -> None:
    (tmp_path / "speech").mkdir()
    (tmp_path / "speech" / "x.wav").write_text("words")
    with pytest.raises(InputError, match=r"x\.wav: cannot be read as sound"):
        speech.utterances(tmp_path)


def test_a_low_rate_recording_is_given_a_hiss_of_its_own_rhythm() -> None:
    said = spoken(3)
    hissing = speech.with_hiss(said, 16_000)
    assert speech.share_in_band_db(hissing) == pytest.approx(-40, abs=3)
    off = np.fft.rfft(hissing - said)
    hz = np.fft.rfftfreq(len(said), 1 / speech.RATE_HZ)
    assert np.abs(off[hz < 12_000]).max() < 0.1 * np.abs(off).max()


@pytest.fixture(scope="module")
def tone_frames() -> object:
    """Of a 16 kHz tone."""
    t_s = np.arange(speech.RATE_HZ) / speech.RATE_HZ
    how = speech.Circumstance(-20.0, chirps=False)
    heard = speech.heard_by_phone(np.cos(2 * np.pi * 16_000 * t_s), how, np.random.default_rng(0))
    return speech.kept_of(heard, chirps=False)


def test_a_tone_of_the_band_is_moved_where_it_is_said(tone_frames: object) -> None:
    made = shifted(tone_frames)
    for name, wanted_hz in (("up at 0 Hz", 1650), ("mirrored at 0 Hz", 4650)):
        power = np.abs(np.fft.rfft(made[name]))
        loudest_hz = np.fft.rfftfreq(len(made[name]), 1 / OUT_HZ)[power.argmax()]
        assert loudest_hz == pytest.approx(wanted_hz, abs=15)


def test_what_frames_have_in_common_is_taken_out_and_the_rest_stays() -> None:
    how = speech.Circumstance(-20.0, chirps=True)
    clean = speech.padded(spoken(4))
    heard = speech.heard_by_phone(speech.moved_into_band(clean), how, np.random.default_rng(1))
    frames = speech.kept_of(heard, chirps=True)
    without = enhanced(frames)
    assert np.abs(line_of(without)).max() < 0.3 * np.abs(line_of(frames)).max()
    before, after = (
        np.mean(
            [speech.intelligibility()(speech.down(clean), way) for way in shifted(each).values()]
        )
        for each in (frames, without)
    )
    assert after > before + 0.05
    assert all(np.isfinite(sound).all() for sound in as_sent(without).values())
