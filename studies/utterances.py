"""Speech for the study of what can be understood: recorded voices, and a voice that is made."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile
from scipy import signal

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError

RATE_HZ = 48_000
BAND_HZ = (14_350, 20_650)
FULL_RATE_HZ = 44_100
"""From here on a recording has the chirp band in it."""
WORDS = Path("/usr/share/sounds/alsa")
"""Debian's alsa-utils: "front, center" and the like, said by a person, 48 kHz."""
SENTENCES = Path("/usr/share/pocketsphinx/test/data/librivox")
"""Debian's pocketsphinx-testdata: five sentences read aloud, 16 kHz."""
LEAST_S = 1.0
KINDS = (".wav", ".flac", ".ogg")
HISS = 10 ** (-40 / 20)
"""What a voice without a band above is given there, of its whole level: more than 16 of 17 voices
recorded at full rate had, which were at -34 to -58 dB."""
HISS_FROM_HZ = 4000
SAID = (
    "She says the sixth shop sells fresh fish",
    "Six scissors lie beside the glass dish",
    "Please send the cash to this address on Sunday",
    "The secret password is seven six zero six",
    "His sister wishes to discuss the price in person",
    "My account number starts with four nine two",
    "We shall meet at the station at half past six",
    "Do not tell anyone what the doctor said",
)
"""Full of s and sh: the sounds that reach highest."""
ADVICE = (
    "install alsa-utils and espeak-ng (apt-get install alsa-utils espeak-ng), or put "
    "recorded speech as .wav files into the folder `speech` of --data"
)


@dataclass(frozen=True, eq=False)
class Utterance:
    """Somebody says something: mono, 48 kHz, an rms of 1; of which set, and called what."""

    name: str
    kind: str
    samples: F64


def utterances(data: Path | None, *, most: int | None = None) -> list[Utterance]:
    """All speech that is at hand, at most so many of each kind.

    "own" is what lies in the folder `speech` of `data`; "words" and "sentences" are recorded,
    "made" is synthesized. What was recorded below 44.1 kHz is given a hiss above. Raises
    InputError where there is neither own nor installed speech.
    """
    own = _files(data / "speech") if data is not None else []
    words = [file for file in _files(WORDS) if file.stem != "Noise"]
    if not own and not (words and shutil.which("espeak-ng")):
        raise InputError(f"speech: none is there; {ADVICE}")
    found: dict[str, list[Utterance]] = {
        "own": [_read("own", [file]) for file in own[:most]],
        "words": [
            _read("words", pair) for pair in list(zip(words[::2], words[1::2], strict=False))[:most]
        ],
        "sentences": [_read("sentences", [file]) for file in _files(SENTENCES)[:most]],
        "made": list(_made(SAID[:most])) if shutil.which("espeak-ng") else [],
    }
    return [each for kind in found.values() for each in kind]


def share_in_band_db(samples: F64) -> float:
    """Of all its power, what lies in the chirp band (dB)."""
    power = np.abs(np.fft.rfft(samples)) ** 2
    hz = np.fft.rfftfreq(len(samples), 1 / RATE_HZ)
    inside = power[(hz >= BAND_HZ[0]) & (hz < BAND_HZ[1])].sum()
    return float(10 * np.log10(max(inside / power.sum(), 1e-20)))


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(file for file in folder.rglob("*") if file.suffix.lower() in KINDS)


def _made(texts: Sequence[str]) -> Iterator[Utterance]:
    """Two voices by turns, by espeak-ng."""
    with tempfile.TemporaryDirectory() as folder:
        for k, text in enumerate(texts):
            file = Path(folder) / f"{text[:24].replace(' ', '_')}.wav"
            voice = ("en-us", "en-gb+f3")[k % 2]
            subprocess.run(["espeak-ng", "-v", voice, "-w", file, text], check=True, timeout=60)
            yield _read("made", [file])


def _read(kind: str, files: Sequence[Path]) -> Utterance:
    """One after the other."""
    parts, rates_hz = [], []
    for file in files:
        try:
            samples, rate_hz = soundfile.read(file, always_2d=True)
        except (OSError, soundfile.LibsndfileError) as cause:
            raise InputError(f"{file}: cannot be read as sound ({cause}); take it out") from cause
        parts.append(signal.resample_poly(samples[:, 0], RATE_HZ, rate_hz))
        rates_hz.append(rate_hz)
    said = np.concatenate(parts)
    if min(rates_hz) < FULL_RATE_HZ:
        said = with_hiss(said, min(rates_hz))
    rms, seconds = np.sqrt(np.mean(said**2)), len(said) / RATE_HZ
    if not (rms > 0 and seconds >= LEAST_S):
        raise InputError(
            f"{files[0]}: has {seconds:.1f} s and an rms of {rms:.3g}, wanted a sentence of "
            f"{LEAST_S:g} s or more that is no silence; take it out"
        )
    return Utterance("+".join(file.stem for file in files), kind, said / rms)


def with_hiss(said: F64, source_rate_hz: int) -> F64:
    """Speech with noise in the chirp band that follows its own highest sounds, 40 dB below it."""
    high = (HISS_FROM_HZ, 0.45 * source_rate_hz)
    top = _filtered(said, high)
    envelope = np.abs(signal.hilbert(top))
    noise = _filtered(np.random.default_rng(0).standard_normal(len(said)), BAND_HZ)
    hiss = noise * envelope
    gain = HISS * np.sqrt(np.mean(said**2) / max(np.mean(hiss**2), 1e-30))
    return np.asarray(said + gain * hiss)


def _filtered(samples: F64, band_hz: tuple[float, float]) -> F64:
    sections = signal.butter(6, band_hz, "bandpass", fs=RATE_HZ, output="sos")
    return np.asarray(signal.sosfiltfilt(sections, samples))
