"""What is left of speech in what the phone keeps: STOI before, as sent, and as an attacker may.

STOI, the short-time objective intelligibility (Taal et al. 2011), is near 1 where every word is
understood. It is not 0 where none is: what noise and unrelated speech get is measured beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.base.values import Audio
from elfslam.data.baseband import Baseband, frame_starts_s, to_baseband
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.scoring.bootstrap import interval
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.world.air import SPEED_OF_SOUND_MPS
from elfslam.world.device import built_in_device
from elfslam.world.interference import record, rumble
from elfslam.world.phone import air_at, render_frames, room_responses
from elfslam.world.scene import scene_of
from elfslam.world.world_file import load_world
from studies.eavesdropping import FORMS, OUT_HZ, enhanced
from studies.figures.speech_figure import Understood, speech_figure
from studies.finding import Finding, Given, Row
from studies.still_phone import held_still
from studies.utterances import BAND_HZ, RATE_HZ, Utterance, share_in_band_db, utterances

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


@dataclass(frozen=True)
class Circumstance:
    """How loud the speech is, and whether the phone chirps."""

    level_dbfs: float
    chirps: bool


def measure_speech(
    given: Given, *, most: int | None = None, levels_dbfs: Sequence[float] = LEVELS_DBFS
) -> Finding:
    """STOI of every utterance, before and after the phone's filter, with and without chirps.

    Own recordings lie in the folder `speech` of `data`. Speech goes through a simulated room to
    the simulated phone, and of what it hears the frames of the chirp band are taken as the page
    takes them. Intervals over utterances. `most` of each kind. Raises InputError where there is
    no speech or pystoi is missing.
    """
    stoi = intelligibility()
    spoken = utterances(given.data, most=most)
    circumstances = [
        Circumstance(level, chirps) for chirps in (False, True) for level in levels_dbfs
    ]
    found: list[tuple[Circumstance, list[dict[str, float]]]] = []
    for k, each in enumerate(circumstances):
        given.announce(f"speech at {each.level_dbfs:g} dBFS", k / len(circumstances))
        found.append((each, [_measured(stoi, spoken, n, each) for n in range(len(spoken))]))
    rows = [row for each, numbers in found for row in _rows(each, numbers)]
    rows += list(_control_rows(stoi, spoken))
    return Finding(rows, _page(rows, spoken, found))


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
    """STOI of one utterance by name of the form; "unrelated" forms are held against another."""
    generator = np.random.default_rng([n, round(-how.level_dbfs), how.chirps])
    clean = padded(spoken[n].samples)
    other = down(padded(spoken[(n + 1) % len(spoken)].samples))
    audio = heard_by_phone(clean, how, generator)
    sent = kept_of(audio, chirps=how.chirps)
    wanted, numbers = down(clean), {"before": stoi(down(clean), down(_row(audio)))}
    for form, made_of in FORMS.items():
        for name, frames in ((form, sent), (f"{form}, enhanced", enhanced(sent))):
            ways = list(made_of(frames).values())
            numbers[name] = max(stoi(wanted, way) for way in ways)
            if frames is sent:
                numbers[f"unrelated {form}"] = max(stoi(other, way) for way in ways)
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


def _control_rows(stoi: Callable[[F64, F64], float], spoken: Sequence[Utterance]) -> Iterable[Row]:
    """What the measure says of speech in noise, and of speech that does lie in the band."""
    for noise_db in NOISY_DB:
        numbers = []
        for n, each in enumerate(spoken):
            clean = down(padded(each.samples))
            noise = np.random.default_rng(n).standard_normal(len(clean))
            loud = np.sqrt(np.mean(clean**2)) * 10 ** (-noise_db / 20)
            numbers.append(stoi(clean, clean + loud * noise))
        yield _row_of(f"control: in white noise, {noise_db:+g} dB", None, numbers)
    silence = Circumstance(SILENCE_DBFS, chirps=True)
    numbers_of = [_measured(stoi, spoken, n, silence) for n in range(len(spoken))]
    for form in (*FORMS, *(f"{form}, enhanced" for form in FORMS)):
        yield _row_of(f"control: nobody speaks, {form}", None, [each[form] for each in numbers_of])
    for form in ("shifted down", "envelope"):
        numbers = []
        for n, each in enumerate(spoken):
            clean = padded(each.samples)
            quiet = Circumstance(-40.0, chirps=False)
            audio = heard_by_phone(moved_into_band(clean), quiet, np.random.default_rng(n))
            ways = FORMS[form](kept_of(audio, chirps=False)).values()
            numbers.append(max(stoi(down(clean), way) for way in ways))
        yield _row_of(f"control: moved into the band, {form}", None, numbers)


def _rows(how: Circumstance, numbers: Sequence[Mapping[str, float]]) -> Iterable[Row]:
    for name in numbers[0]:
        if not name.startswith("unrelated"):
            form = name.removesuffix(", enhanced")
            floor = [each.get(f"unrelated {form}", np.nan) for each in numbers]
            yield _row_of(name, how, [each[name] for each in numbers], floor)


def _row_of(
    name: str, how: Circumstance | None, values: Sequence[float], floor: Sequence[float] = ()
) -> Row:
    low, high = interval(
        [np.array([value]) for value in values], lambda all: float(all.mean()),
        np.random.default_rng(0),
    )  # fmt: skip
    known = [value for value in floor if np.isfinite(value)]
    return {
        "what": name,
        "speech (dBFS)": how.level_dbfs if how else None,
        "chirps": how.chirps if how else None,
        "utterances": len(values),
        "STOI": round(float(np.mean(values)), 3),
        "from": round(low, 3),
        "to": round(high, 3),
        "highest": round(float(np.max(values)), 3),
        "unrelated": round(float(np.mean(known)), 3) if known else None,
    }


def _page(
    rows: Sequence[Row],
    spoken: Sequence[Utterance],
    found: Sequence[tuple[Circumstance, Sequence[Mapping[str, float]]]],
) -> Page:
    panels = []
    for chirps, title in ((True, "While the phone chirps"), (False, "Without chirps")):
        shown = {
            f"{how.level_dbfs:g} dBFS": _understood(numbers)
            for how, numbers in found
            if how.chirps is chirps
        }
        panels.append(Panel(title, speech_figure(shown), NOTE, wide=True))
    panels.append(Panel("All figures", rows_table(rows), wide=True))
    loudest = max((how.chirps, how.level_dbfs, k) for k, (how, _) in enumerate(found))[2]
    facts = [_facts(*pair) for pair in zip(spoken, found[loudest][1], strict=True)]
    panels.append(Panel(EACH, rows_table(facts), wide=True))
    subtitle = f"{len(spoken)} utterances beside a phone in a simulated room"
    return Page("What is left of speech in what the phone sends", subtitle, panels)


EACH = "Each utterance, at its loudest, while the phone chirps"
NOTE = (
    "Each dot is an utterance; of several ways to listen the best one counts. Grey: the same ways "
    "held against another utterance, which is what chance gives."
)


def _understood(numbers: Sequence[Mapping[str, float]]) -> Understood:
    return {name: np.array([each[name] for each in numbers]) for name in numbers[0]}


def _facts(each: Utterance, numbers: Mapping[str, float]) -> Row:
    ways = [name for name in numbers if name.startswith(tuple(FORMS))]
    return {
        "name": each.name,
        "kind": each.kind,
        "seconds": round(len(each.samples) / RATE_HZ, 1),
        "in the chirp band (dB)": round(share_in_band_db(each.samples), 1),
        "before": numbers["before"],
        "best way": max(numbers[name] for name in ways),
    }
