"""What is left of speech in what the phone keeps: STOI before, as sent, and as an attacker may.

STOI, the short-time objective intelligibility (Taal et al. 2011), is near 1 where every word is
understood. It is not 0 where none is: what noise and unrelated speech get is measured beside it.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import soundfile
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.base.values import Audio
from elfslam.data.baseband import Baseband, frame_starts_s, to_baseband
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.device import built_in_device
from elfslam.world.interference import record, rumble
from elfslam.world.phone import air_at, render_frames, room_responses
from elfslam.world.pulses import SPEED_OF_SOUND_MPS
from elfslam.world.scene import scene_of
from elfslam.world.world_file import load_world
from studies.eavesdropping import FORMS, OUT_HZ, enhanced
from studies.results import Record, mean_of
from studies.still_phone import held_still
from studies.study import Study, StudyContext

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
WORLD = "studio"
LEVELS_DBFS = (-60.0, -40.0, -20.0)
"""Of the speech at the microphone: talk at a metre, a loud voice close by, a shout into the phone
(by the 94 dB SPL at -26 dBFS of common phone microphones: 60, 80 and 100 dB)."""
TALKER_M = (1.0, 0.3, 0.4)
"""From the phone: as far as somebody who walks beside it."""
WALL_GAIN = 0.85
RESPONSE_S = 0.3
LEAD_S = 0.4
"""Before the first word and after the last."""
NOISY_DB = (0.0, -10.0, -60.0)
"""The last is noise alone: what STOI gives where there is nothing to understand."""
SILENCE_DBFS = -200.0
BEFORE, UNRELATED = "microphone", "unrelated: "
NOBODY, MOVED = "nobody speaks", "moved into the band"


@dataclass(frozen=True)
class Circumstance:
    """How loud the speech is, and whether the phone chirps."""

    level_dbfs: float
    chirps: bool

    def __str__(self) -> str:
        return f"{self.level_dbfs:g} dBFS, {'' if self.chirps else 'no '}chirps"


def measure_speech(
    context: StudyContext, *, most: int | None = None, levels_dbfs: Sequence[float] = LEVELS_DBFS
) -> list[Record]:
    """STOI before and after the phone's filter (the method), with and without chirps.

    Own recordings lie in the folder `speech` of `data`. Speech goes through a simulated room to
    the simulated phone, and of what it hears the frames of the chirp band are taken as the page
    takes them. Intervals over utterances. `most` of each kind. Raises InputError where there is
    no speech or pystoi is missing.
    """
    stoi = intelligibility()
    spoken = utterances(context.data, most=most)
    circumstances = [
        Circumstance(level, chirps) for chirps in (False, True) for level in levels_dbfs
    ]
    records: list[Record] = []
    for k, each in enumerate(circumstances):
        context.announce(f"speech at {each.level_dbfs:g} dBFS", k / len(circumstances))
        found = [_measured(stoi, spoken, n, each) for n in range(len(spoken))]
        records += _records(each, found)
    return [*records, *_controls(stoi, spoken)]


def _records(how: Circumstance, numbers: Sequence[Mapping[str, float]]) -> Iterator[Record]:
    for name in numbers[0]:
        kind, method = name.startswith(UNRELATED), name.removeprefix(UNRELATED)
        values = [each[name] for each in numbers]
        if kind:
            yield mean_of(Record(method, "STOI against another utterance", 0.0,
                                 condition=str(how)), values)  # fmt: skip
        else:
            yield from _of(method, str(how), values)


def _of(method: str, condition: str, values: Sequence[float]) -> Iterator[Record]:
    yield mean_of(Record(method, "STOI", 0.0, condition=condition), values)
    yield Record(method, "highest STOI", max(values), condition=condition)


def intelligibility() -> Callable[[F64, F64], float]:
    """STOI of (clean, other) at 10 kHz, as far as both go; 0 of silence. Raises InputError."""
    try:
        from pystoi import stoi
    except ImportError as cause:
        raise InputError(
            "study speech: needs pystoi, which is not installed; install it (pip install pystoi)"
        ) from cause

    def measure(clean: F64, other: F64) -> float:
        count = min(len(clean), len(other))
        if not np.any(other[:count]):
            return 0.0
        return float(stoi(clean[:count], other[:count], OUT_HZ))

    return measure


def _measured(
    stoi: Callable[[F64, F64], float], spoken: Sequence[Utterance], n: int, how: Circumstance
) -> dict[str, float]:
    """STOI of one utterance by name of the form; those held against another are UNRELATED."""
    generator = np.random.default_rng([n, round(-how.level_dbfs), how.chirps])
    clean = padded(spoken[n].samples)
    other = down(padded(spoken[(n + 1) % len(spoken)].samples))
    audio = heard_by_phone(clean, how, generator)
    sent = kept_of(audio, chirps=how.chirps)
    wanted, numbers = down(clean), {BEFORE: stoi(down(clean), down(_row(audio)))}
    for form, made_of in FORMS.items():
        for name, frames in ((form, sent), (f"{form}, enhanced", enhanced(sent))):
            ways = list(made_of(frames).values())
            numbers[name] = max(stoi(wanted, way) for way in ways)
            if frames is sent:
                numbers[f"{UNRELATED}{form}"] = max(stoi(other, way) for way in ways)
    return numbers


def heard_by_phone(clean: F64, how: Circumstance, generator: np.random.Generator) -> Audio:
    """What the simulated phone records of speech in a room, with its own chirps or without.

    The speech arrives without delay, so that it can be compared.
    """
    device = built_in_device("simulated phone")
    room = signal.oaconvolve(clean, talker_response())[: len(clean)]
    gain = 10 ** (how.level_dbfs / 20) / np.sqrt(np.mean(room**2))
    stream = (gain * room).astype(np.float32)
    stream += rumble(len(stream), RATE_HZ, generator)
    if how.chirps:
        stream += np.resize(_chirps(), len(stream))
    return Audio(record(stream, device, generator)[None], RATE_HZ)


def kept_of(audio: Audio, *, chirps: bool) -> Baseband:
    """The frames that the page keeps: where chirps arrive, and without them ten a second."""
    if chirps:
        starts_s = frame_starts_s(audio, make_chirp(ChirpParameters(), RATE_HZ))
    else:
        starts_s = np.arange(0, audio.samples.shape[1] / RATE_HZ - 0.1, 0.1)
    return to_baseband(audio, starts_s)


@cache
def _chirps() -> F32:
    """Forty chirps and their echoes, by a phone that a hand holds still."""
    world, device = load_world(WORLD), built_in_device("simulated phone")
    place_m = world.room.corner_m + world.room.size_m[:2] / 2
    poses = held_still(place_m, 40, np.random.default_rng(3))
    heard = room_responses(scene_of(world.room), device, poses, air_at())
    return np.asarray(render_frames(heard, make_chirp(ChirpParameters(), RATE_HZ), device).ravel())


@cache
def talker_response() -> F64:
    """Of the room, from a talker to the phone, from the direct sound on: image sources of a box.

    All frequencies alike (Allen and Berkley 1979), which is kind to the attacker: walls and air
    take the chirp band away first.
    """
    size_m = load_world(WORLD).room.size_m
    phone_m = size_m / 2
    talker_m = phone_m + np.array(TALKER_M)
    reach = np.ceil(RESPONSE_S * SPEED_OF_SOUND_MPS / (2 * size_m)).astype(int)
    axes = [_images(talker_m[k], size_m[k], reach[k]) for k in range(3)]
    squares = [(place - phone_m[k]) ** 2 for k, (place, _) in enumerate(axes)]
    distance_m = np.sqrt(
        squares[0][:, None, None] + squares[1][None, :, None] + squares[2][None, None]
    )
    counts = axes[0][1][:, None, None] + axes[1][1][None, :, None] + axes[2][1][None, None]
    gain = WALL_GAIN**counts / distance_m
    sample = np.round((distance_m - distance_m.min()) / SPEED_OF_SOUND_MPS * RATE_HZ).astype(int)
    early = sample < RESPONSE_S * RATE_HZ
    return np.asarray(np.bincount(sample[early], gain[early]), dtype=np.float64)


def _images(place_m: float, size_m: float, reach: int) -> tuple[F64, F64]:
    """Places of the images along one axis, and how often each was reflected."""
    k = np.arange(-reach, reach + 1)
    return np.concatenate([2 * k * size_m + place_m, 2 * k * size_m - place_m]), np.concatenate(
        [np.abs(2.0 * k), np.abs(2.0 * k - 1)]
    )


def padded(samples: F64) -> F64:
    """With quiet before and after."""
    return np.pad(samples, round(LEAD_S * RATE_HZ))


def down(samples: F64) -> F64:
    """At the rate at which intelligibility is measured."""
    return np.asarray(signal.resample_poly(samples, OUT_HZ, RATE_HZ))


def _row(audio: Audio) -> F64:
    return np.asarray(audio.samples[0], dtype=np.float64)


def moved_into_band(samples: F64) -> F64:
    """Speech that somebody moved up into the chirp band: what the measure must not miss."""
    low = signal.sosfiltfilt(signal.butter(8, 3000, fs=RATE_HZ, output="sos"), samples)
    t_s = np.arange(len(samples)) / RATE_HZ
    return np.asarray((signal.hilbert(low) * np.exp(2j * np.pi * BAND_HZ[0] * t_s)).real)


def _controls(stoi: Callable[[F64, F64], float], spoken: Sequence[Utterance]) -> Iterator[Record]:
    """What the measure makes of speech in noise, of silence, and of speech that is in the band."""
    padded_speech = [padded(each.samples) for each in spoken]
    for noise_db in NOISY_DB:
        values = [_in_noise(stoi, down(clean), noise_db, n)
                  for n, clean in enumerate(padded_speech)]  # fmt: skip
        yield from _of("in white noise", f"{noise_db:+g} dB", values)
    silence = Circumstance(SILENCE_DBFS, chirps=True)
    numbers = [_measured(stoi, spoken, n, silence) for n in range(len(spoken))]
    for form in (*FORMS, *(f"{form}, enhanced" for form in FORMS)):
        yield from _of(form, NOBODY, [each[form] for each in numbers])
    quiet = Circumstance(-40.0, chirps=False)
    for form in ("shifted down", "envelope"):
        values = []
        for n, clean in enumerate(padded_speech):
            audio = heard_by_phone(moved_into_band(clean), quiet, np.random.default_rng(n))
            ways = FORMS[form](kept_of(audio, chirps=False)).values()
            values.append(max(stoi(down(clean), way) for way in ways))
        yield from _of(form, MOVED, values)


def _in_noise(stoi: Callable[[F64, F64], float], clean: F64, noise_db: float, seed: int) -> float:
    noise = np.random.default_rng(seed).standard_normal(len(clean))
    loud = np.sqrt(np.mean(clean**2)) * 10 ** (-noise_db / 20)
    return stoi(clean, clean + loud * noise)


# --- utterances ---


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


STUDY = Study(
    "Is anything understood of speech near a phone in what the phone keeps?",
    measure_speech, minutes=8, needs=("pystoi",),
    fast={"most": 1, "levels_dbfs": (-20.0,)},
)  # fmt: skip
