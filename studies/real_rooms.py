"""Real impulse responses: is a place known again when the walls or the microphone changed?

Room impulse responses of Meta's R3VIVAL set (CC BY 4.0): twelve loudspeakers on a circle about
the microphones, eight states of the walls' absorption in one room. The circle of 2 m is a test:
nothing is trained or chosen by it. By that of 1.5 m it was chosen that the root spectrogram stands
beside what the shipped encoder learnt (`elfslam.learn.network`).
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Chirp
from elfslam.baselines.generic import generic_encoders
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import EchoParameters, cut_echoes
from elfslam.stages.feature import Encoder, load_encoder
from studies.results import Record, mean_of
from studies.study import Study, StudyContext

FILES: Mapping[float, Path] = {
    2.0: Path("rirs") / "r3vival_2m.npz",
    1.5: Path("rirs") / "r3vival_1.5m.npz",
}
"""By the radius of the circle, in metres."""
REPEATS = 8
PERIOD_S = 0.25
"""A chirp, its sound in the room (140 ms) and silence; so that one does not ring into the next."""
PEAK = 0.5
REFERENCE = 0
"""State of the walls and microphone that make the gallery: 000, at the centre."""
PLAIN = "plain spectrogram"


def measure_real_rooms(
    context: StudyContext, *, encoders: Mapping[str, Encoder] | None = None
) -> list[Record]:
    """By circle (world), microphone (condition) and feature, the share of queries (states of the
    walls, places) whose nearest of twelve places is the right one.

    Features lose what all places of a state have in common, as those of a walk do. Intervals
    resample the places. `encoders` are measured by name beside the spectrograms, by default the
    shipped one. Raises InputError without the real recordings.
    """
    compared = {**hand_made(), **(encoders or {"ELF, shipped": load_encoder("compact")})}
    records: list[Record] = []
    for done, circle_m in enumerate(FILES):
        context.announce(f"circle of {circle_m:g} m", done / len(FILES))
        responses, rate_hz, microphones = read_responses(context.data, circle_m)
        echoes = np.stack([_echoes(state, rate_hz) for state in responses])
        vectors = {name: _vectors(echoes, encoder) for name, encoder in compared.items()}
        for k, microphone in enumerate(microphones):
            of = Record("", "top-1 accuracy", world=f"circle of {circle_m:g} m",
                        condition=microphone)  # fmt: skip
            for name, each in vectors.items():
                right = recognised(own(each, places=1), k).astype(np.float64)
                records.append(mean_of(replace(of, method=name), right.mean(axis=0)))
    return records


def read_responses(data: Path | None, circle_m: float) -> tuple[F32, int, list[str]]:
    """Impulse responses (states, places, microphones, n), their rate, the microphones' names."""
    file = None if data is None else data / FILES[circle_m]
    if file is None or not file.exists():
        raise InputError(
            f"real impulse responses: {file or FILES[circle_m]} is absent; "
            "pass --data or set ELFSLAM_DATA"
        )
    with np.load(file, allow_pickle=False) as archive:
        responses = np.moveaxis(archive["rir"], 2, 3)
        return responses, int(archive["rate_hz"]), [str(name) for name in archive["microphone"]]


def hand_made() -> dict[str, Encoder]:
    """The spectrograms that were not learned, by name."""
    known = generic_encoders()
    return {
        PLAIN: known["spectrogram without mean"],
        **{name: known[name] for name in ("root spectrogram", "log spectrogram")},
    }


def own(vectors: F32, *, places: int = 0) -> F32:
    """Unit vectors (..., d) less what the places, an axis of theirs, have in common."""
    rest = vectors - vectors.mean(axis=places, keepdims=True)
    return np.asarray(rest / np.maximum(np.linalg.norm(rest, axis=-1, keepdims=True), 1e-12))


def recognised(vectors: F32, microphone: int) -> Bool:
    """Whether the nearest of the reference places is the right one: (changed states, places).

    `vectors` are (states, places, microphones, d); the gallery is always the centre microphone.
    """
    gallery = vectors[REFERENCE, :, REFERENCE]
    queries = np.delete(vectors[:, :, microphone], REFERENCE, axis=0)
    return np.asarray((queries @ gallery.T).argmax(axis=2) == np.arange(len(gallery)))


def echo_of(response: F64, chirp: Chirp) -> F32:
    """The echo trace (2352) that the pipeline cuts from chirps played through a response (n)."""
    sound = signal.fftconvolve(chirp.samples.astype(np.float64), response)
    frame = np.zeros(round(chirp.period_s * chirp.rate_hz))
    frame[: len(sound)] = PEAK * sound / np.abs(sound).max()
    audio = Audio(np.tile(frame, REPEATS)[None].astype(np.float32), chirp.rate_hz)
    echoes = cut_echoes(audio, chirp, replace(EchoParameters(), minimum_duration_s=1.0))
    return np.asarray(echoes.samples[REPEATS // 2])


def _echoes(state: F32, rate_hz: int) -> F32:
    """Echoes (places, microphones, 2352) of the responses of one state."""
    chirp = make_chirp(replace(ChirpParameters(), period_s=PERIOD_S), rate_hz)
    return np.stack([[echo_of(response, chirp) for response in place] for place in state])


def _vectors(echoes: F32, encoder: Encoder) -> F32:
    """Unit vectors (states, places, microphones, d) of echoes (states, places, microphones, n)."""
    rows = encoder.embed(echoes.reshape(-1, echoes.shape[-1]))
    return rows.reshape(*echoes.shape[:3], -1)


STUDY = Study(
    "Is a real place known again when its walls or the microphone changed?",
    measure_real_rooms, minutes=1, data=tuple(map(str, FILES.values())), encoders=True,
)  # fmt: skip
