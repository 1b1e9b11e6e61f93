"""Are simulated phones like real ones? What each hears of itself and of the room, side by side.

Measured: phones in a hand or on a table that play a sweep and record themselves
(LibAcousticSensing, MIT). Simulated: the devices that were modelled on them, and ordinary phones,
along the routes of development worlds.
Levels are against the peak of the direct sound; noise is that of a single chirp after pulse
compression. Of measured ones it is an upper bound: what a loudspeaker distorts counts as noise.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.slam.front_end import LEAST_OVER_NOISE_DB
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.device import MEASURED as MODELLED
from elfslam.world.device import built_in_device
from studies.plain_features import ELF, ROOT, compared_encoders
from studies.real_rooms import own
from studies.realism import (
    BAND_HZ,
    RATE_HZ,
    WINDOWS_MS,
    banded,
    echoes_of,
    kurtosis,
    places_along,
    reverberation_s,
    spread_db,
)
from studies.results import Record
from studies.study import Study, StudyContext

FILE = Path("phones") / "responses.npz"
WORLDS, DEVICES = ("studio", "lounge", "hall"), ("ordinary phone", "other ordinary phone")
"""Development worlds, and simulated phones that are not modelled on measured ones."""
ROOMS = ("studio", "lounge")
"""Where the modelled ones are heard: rooms, as those of the measured phones seem to be."""
PLACES = 40
MEASURED, SIMULATED = "measured", "simulated"
SWEEP_GAIN_DB = 26.0
"""What the sweep of four seconds gains over a chirp of 10 ms."""


@dataclass(frozen=True, eq=False)
class Heard:
    """Responses (n, samples) of one microphone from their direct sound on, and noise (n) beside it.

    The noise is that of one chirp, in the unit of the responses.
    """

    name: str
    kind: str
    responses: F64
    noise_rms: F64


def measure_phones(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    devices: Sequence[str] = DEVICES,
    rooms: Sequence[str] = ROOMS,
    modelled: Sequence[str] = tuple(MODELLED),
    places: int = PLACES,
) -> list[Record]:
    """Statistics of what each phone hears, by window of delay; and how repeats are known again."""
    assert context.data is not None
    heard = measured_phones(context.data / FILE)
    for name in modelled:
        heard.append(simulated_phone(MODELLED[name].setup, name, rooms, places))
    for name, world in product(devices, worlds):
        heard.append(simulated_phone(f"{name}, {world}", name, (world,), places))
    repeats = [each for each in heard if each.kind == MEASURED and len(each.responses) > 1]
    return [record for each in heard for record in _records(each)] + list(_likeness(repeats))


def measured_phones(file: Path) -> list[Heard]:
    """Each set-up and microphone of the file."""
    with np.load(file, allow_pickle=False) as archive:
        responses = archive["response"][:, int(archive["direct_sample"]) :].astype(np.float64)
        noise_rms = archive["noise_rms"] * 10 ** (SWEEP_GAIN_DB / 20)
        setups = [
            f"{name}, {k}" for name, k in zip(archive["setup"], archive["microphone"], strict=True)
        ]
    rows = {name: np.array([each == name for each in setups]) for name in dict.fromkeys(setups)}
    return [Heard(name, MEASURED, responses[its], noise_rms[its]) for name, its in rows.items()]


def simulated_phone(name: str, device: str, worlds: Sequence[str], places: int) -> Heard:
    """A simulated phone along the routes of worlds, as a sweep with its noise would measure it."""
    clean = [places_along(world, "diffuse", places, (), device).responses for world in worlds]
    return as_swept(name, np.concatenate(clean), compressed_noise_rms(device))


def as_swept(name: str, responses: F64, noise_rms: float) -> Heard:
    """Responses with what is left of a chirp's noise in their band after a long sweep."""
    share = (BAND_HZ[1] - BAND_HZ[0]) / (RATE_HZ / 2)
    noise = np.random.default_rng(0).standard_normal(responses.shape) / np.sqrt(share)
    left = noise_rms * 10 ** (-SWEEP_GAIN_DB / 20)
    return Heard(name, SIMULATED, responses + left * noise, np.full(len(responses), noise_rms))


def compressed_noise_rms(device: str) -> float:
    """The noise of a simulated phone in the response that one chirp measures, in its band.

    White noise over the spectrum of a chirp whose energy fills a share of all frequencies.
    """
    phone, chirp = built_in_device(device), make_chirp(ChirpParameters(), RATE_HZ)
    share = (BAND_HZ[1] - BAND_HZ[0]) / (RATE_HZ / 2)
    energy = float(np.sum(np.square(chirp.samples, dtype=np.float64)))
    return phone.noise_rms / phone.level * share / float(np.sqrt(energy))


def _records(phone: Heard) -> Iterator[Record]:
    band = banded(phone.responses, RATE_HZ)
    direct = np.abs(band[:, : RATE_HZ // 1000]).max(axis=1)
    of = Record(phone.kind, "", 0.0, world=phone.name)
    echo_db = level_db(band, direct)
    by_window = {
        "kurtosis": kurtosis(band, RATE_HZ),
        "spread (dB)": spread_db(band, RATE_HZ),
        "echo over direct (dB)": echo_db,
    }
    for metric, values in by_window.items():
        for (first, last), value in zip(WINDOWS_MS, values, strict=True):
            yield replace(of, metric=metric, value=value, condition=f"{first} to {last} ms")
    noise_db = float(np.median(20 * np.log10(phone.noise_rms / direct)))
    t60_ms = 1000 * reverberation_s(band, RATE_HZ)
    if np.isfinite(t60_ms):
        yield replace(of, metric="T60 (ms)", value=t60_ms)
    yield replace(of, metric="noise over direct (dB)", value=noise_db)
    yield replace(of, metric="echo over noise (dB)", value=echo_db[0] - noise_db)
    yield replace(of, metric="can map", value=float(echo_db[0] - noise_db > LEAST_OVER_NOISE_DB))


def level_db(band: F64, direct: F64) -> list[float]:
    """Root mean square of responses (n, samples) in each window over their direct peaks (n), dB."""
    windows = [slice(*(round(each * RATE_HZ / 1000) for each in window)) for window in WINDOWS_MS]
    rms = [np.sqrt(np.mean(band[:, window] ** 2, axis=1)) for window in windows]
    return [float(np.median(20 * np.log10(each / direct))) for each in rms]


def _likeness(phones: Sequence[Heard]) -> Iterator[Record]:
    """Cosines of repeats of one set-up, and of the most similar repeat of another, by feature.

    Of responses in which the front end finds the chirps.
    """
    found = [(phone.name, echo) for phone in phones for echo in map(_echo, phone.responses)]
    names = np.array([name for name, echo in found if echo is not None])
    for phone in phones:
        share = np.mean([echo is not None for name, echo in found if name == phone.name])
        yield Record(phone.kind, "chirps found", float(share), world=phone.name)
    same = (names[:, None] == names) & ~np.eye(len(names), dtype=bool)
    asked, other = same.any(axis=1), names[:, None] != names
    echoes = np.stack([echo for _, echo in found if echo is not None])
    for feature in (ELF, ROOT):
        cosines = _cosines(compared_encoders()[feature].embed(echoes))
        repeat = np.where(same, cosines, -1.0).max(axis=1)[asked]
        elsewhere = np.where(other, cosines, -1.0).max(axis=1)[asked]
        of = Record(feature, "", 0.0, world="all real phones")
        yield replace(of, metric="cosine of repeats", value=float(np.median(cosines[same])))
        yield replace(
            of, metric="cosine of the most similar other", value=float(np.median(elsewhere))
        )
        yield replace(of, metric="top-1 accuracy", value=float(np.mean(repeat > elsewhere)))


def _echo(response: F64) -> F32 | None:
    """The echo of a chirp through a response; None where the front end finds no chirps."""
    try:
        return np.asarray(echoes_of(response[None])[0])
    except InputError:
        return None


def _cosines(vectors: F32) -> F64:
    rest = own(vectors)
    return np.asarray(rest @ rest.T, dtype=np.float64)


STUDY = Study(
    "Are simulated phones like real ones, by what they hear of themselves and of the room?",
    measure_phones, minutes=3, data=(str(FILE),),
    fast={
        "worlds": ("studio",), "devices": ("ordinary phone",), "rooms": ("studio",),
        "modelled": ("galaxy s4 mic 1", "iphone 5c up in hand"), "places": 6,
    },
)  # fmt: skip
