"""Feature mean normalisation, and encoders: each echo trace becomes a unit vector, row by row."""

from __future__ import annotations

import hashlib
import threading
from functools import cache
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from elfslam.base.arguments import checked
from elfslam.base.arrays import F32
from elfslam.base.bounds import MEBIBYTE
from elfslam.base.card import Card, card_in
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_bytes
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE, Echoes, Features

SHIPPED_ENCODER = Path(__file__).parents[1] / "weights" / "compact.onnx"
WINDOW_SAMPLES = 96
HOP_SAMPLES = 48
FIRST_BIN = 33
BINS = 12
"""Bins 33 to 44 of a 96-point window at 44.1 kHz: 15.2 to 20.2 kHz."""
QUIET = 1e-7
"""Added to magnitudes before the logarithm, so that silence has one."""
BATCH = 64
BATCH_S = 60.0
"""The slowest machine does a batch in a second."""
BATCH_TICKS = 20
MOST_GRAPH_BYTES = 256 * MEBIBYTE
MOST_RUN_BYTES = 512 * MEBIBYTE
"""What all graphs of a process may hold while they run; ours take 30 MiB."""
SESSION = ("session.use_env_allocators", "session.use_device_allocator_for_initializers")
SILENT = 4
UNIT_SLACK = 1e-3
PRIOR_FRAMES = 30
"""Frames of the zero prior of the running mean: 3 s."""
STILL_ECHOES = 5
"""An echo is compared with the one so many before it, half a second, to tell whether one stands."""
STILL = 0.6
"""The cosine of such two ELFs above which the phone stands: walking 0.9 are below, standing 0.1."""
SUCCESSIVE = 0.45
"""The cosine of successive ELFs of a quiet phone that walks: 0.44 to 0.63 in diffuse rooms and
halls."""
STILL_WEIGHT = 0.05
"""What an echo counts where the phone stands. Not nothing: a phone may add so much of its own that
all its echoes are alike."""


@runtime_checkable
class Encoder(Protocol):
    """Echo traces in, unit vectors out, each row by itself."""

    @property
    def identity(self) -> str:
        """What must be equal for two features to be comparable."""
        ...

    @property
    def still(self) -> float:
        """The cosine of echoes half a second apart above which the phone stands; 1 if never."""
        ...

    @property
    def successive(self) -> float:
        """The least usual cosine of successive echoes of a quiet phone that walks, each less what
        they have in common; 0 where noise is not to be told by it."""
        ...

    def embed(self, samples: F32) -> F32:
        """Unit vectors (n, d) from aligned traces (n, 2352)."""
        ...


def spectrogram(samples: F32) -> F32:
    """Magnitude spectrograms (n, 12, 48) of traces (n, 2352): 96-point Hann, hop 48, 15-20 kHz."""
    frames = np.lib.stride_tricks.sliding_window_view(samples, WINDOW_SAMPLES, axis=1)
    window = np.hanning(WINDOW_SAMPLES + 1)[:-1].astype(np.float32)
    spectrum = np.fft.rfft(frames[:, ::HOP_SAMPLES] * window, axis=2)
    magnitude = np.abs(spectrum[:, :, FIRST_BIN : FIRST_BIN + BINS])
    return np.ascontiguousarray(magnitude.transpose(0, 2, 1), dtype=np.float32)


class SpectralEncoder:
    """No learning: the log spectrogram without its mean per row and its decay over time."""

    identity = "spectral-1"
    still = 1.0
    successive = 0.1

    def embed(self, samples: F32) -> F32:
        """Unit vectors (n, 576)."""
        level = np.log(spectrogram(samples) + QUIET)
        level -= level.mean(axis=2, keepdims=True)
        time = np.linspace(-1.0, 1.0, level.shape[2], dtype=np.float32)
        slope = (level * time).sum(axis=2, keepdims=True) / (time**2).sum()
        flat = (level - slope * time).reshape(len(samples), -1)
        return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12))


class OnnxEncoder:
    """One ONNX graph from raw aligned samples (n, 2352) to the ELF (n, 128).

    Raises InputError where the file is missing or is not such a graph. One from others may do
    anything: it has so much memory, `batch_s` for each batch, and its vectors are checked.
    """

    still = STILL
    successive = SUCCESSIVE

    def __init__(self, content: bytes, name: str, batch_s: float = BATCH_S) -> None:
        import onnxruntime

        _bound_memory()
        options = onnxruntime.SessionOptions()
        options.log_severity_level = SILENT
        # Of two threads the second costs as much as it saves.
        options.intra_op_num_threads = 1
        for entry in SESSION:
            options.add_session_config_entry(entry, "1")
        self.content, self.name, self._batch_s = content, name, batch_s
        self.identity = hashlib.sha256(content).hexdigest()[:16]
        try:
            self._session: Any = onnxruntime.InferenceSession(
                content, options, providers=["CPUExecutionProvider"]
            )
        except Exception as cause:  # onnxruntime raises its own exception types
            raise InputError(
                f"encoder {name}: not a readable ONNX graph; pass the .onnx file of an encoder"
            ) from cause
        inputs = {item.name: item.shape for item in self._session.get_inputs()}
        outputs = [item.name for item in self._session.get_outputs()]
        if inputs.get("samples", [0, 0])[1:] != [ECHO_SAMPLES] or "elf" not in outputs:
            raise InputError(
                f"encoder {name}: wanted input samples (n, {ECHO_SAMPLES}) and output elf, "
                f"got {inputs}; export it with `elfslam pretrain`"
            )

    def __reduce__(self) -> tuple[type[OnnxEncoder], tuple[bytes, str, float]]:
        """Travels to another process as its file."""
        return OnnxEncoder, (self.content, self.name, self._batch_s)

    @property
    def card(self) -> Card | None:
        """How it was made, None where its file does not say. Raises InputError if damaged."""
        return card_in(self._session.get_modelmeta().custom_metadata_map)

    def embed(self, samples: F32) -> F32:
        """Unit vectors (n, 128) of traces (n, 2352).

        Raises InputError where the graph fails, takes too long, or gives anything else.
        """
        if len(samples) == 0:
            return np.zeros((0, ELF_SIZE), dtype=np.float32)
        rows = np.ascontiguousarray(samples)
        return np.concatenate([self._run(rows[k : k + BATCH]) for k in range(0, len(rows), BATCH)])

    def _run(self, samples: F32) -> F32:
        """The unit vectors of one batch. Raises InputError."""
        import onnxruntime

        options = onnxruntime.RunOptions()
        options.log_severity_level = SILENT
        done = threading.Event()
        threading.Thread(
            target=_stop_late, args=(options, done, self._batch_s / BATCH_TICKS), daemon=True
        ).start()
        try:
            made = self._session.run(["elf"], {"samples": samples}, options)[0]
        except Exception as cause:  # onnxruntime raises its own exception types
            late = f"takes more than {self._batch_s:g} s for {len(samples)} echoes"
            why = late if options.terminate else f"fails ({' '.join(str(cause).split()):.120})"
            raise InputError(f"encoder {self.name}: {why}; choose another") from cause
        finally:
            done.set()
        if not _are_unit_rows(made, len(samples)):
            raise InputError(
                f"encoder {self.name}: gives something else than a vector of {ELF_SIZE} numbers "
                "and of length 1 for each echo; choose another"
            )
        return np.asarray(made)


def _stop_late(options: Any, done: threading.Event, tick_s: float) -> None:
    """End the run of these options unless it is done within BATCH_TICKS waits of `tick_s`.

    Waits are counted: after a process was halted for an hour, one of them is over and not all.
    """
    for _ in range(BATCH_TICKS):
        if done.wait(tick_s):
            return
    options.terminate = True


def _are_unit_rows(made: object, rows: int) -> bool:
    if not isinstance(made, np.ndarray) or made.dtype != np.float32:
        return False
    # NaN fails the comparison.
    return made.shape == (rows, ELF_SIZE) and bool(
        (np.abs(np.linalg.norm(made, axis=1) - 1) < UNIT_SLACK).all()
    )


@cache
def _bound_memory() -> None:
    """Give the graphs of this process one allocator, with a limit, to share."""
    import onnxruntime

    kind = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR
    memory = onnxruntime.OrtMemoryInfo("Cpu", kind, 0, onnxruntime.OrtMemType.DEFAULT)
    limit = onnxruntime.OrtArenaCfg({"max_mem": MOST_RUN_BYTES})
    onnxruntime.create_and_register_allocator(memory, limit)


@checked
def load_encoder(name: Path | str) -> Encoder:
    """The encoder called `name`: "compact" (shipped), "spectral" (no learning) or an ONNX file."""
    if name == "spectral":
        return SpectralEncoder()
    if name == "compact":
        return OnnxEncoder(SHIPPED_ENCODER.read_bytes(), name)
    if not Path(name).exists():
        raise InputError(
            f"encoder {name!r}: wanted compact, spectral or an ONNX file; no such file"
        )
    return OnnxEncoder(read_bytes(Path(name), MOST_GRAPH_BYTES), str(name))


def read_card(name: str) -> Card | None:
    """The card of the encoder that `load_encoder` finds by this name; None where it has none."""
    encoder = load_encoder(name)
    return encoder.card if isinstance(encoder, OnnxEncoder) else None


def extract_features(echoes: Echoes, encoder: Encoder) -> Features:
    """The feature of every echo, less what those so far have in common."""
    vectors = walk_vectors(echoes.samples, encoder)
    attenuation = attenuation_of(vectors, echoes.over_noise_db, encoder.successive)
    return Features(echoes.t_s, vectors, encoder.identity, attenuation)


QUIET_PHONE_DB = 13.0
"""Echoes over noise of the phones by which thresholds were chosen, at least."""
LEAST_RELIABILITY = 0.36
"""Of mean features; corrected for less, noise passes for places."""
NO_RELIABILITY = 0.13
"""Below, echoes are noise: nothing gives back what they do not carry."""


def attenuation_of(vectors: F32, over_noise_db: float, successive: float) -> float:
    """By what share noise shortens the mean of features (n, d), against a phone that has little.

    It is 1 where echoes lie well over their noise, or where `over_noise_db` is unknown (NaN). The
    mean of noisy features is that without noise times the root of their reliability: the
    attenuation of Spearman (1904). Reliability is the correlation of two measurements of one
    thing. Two successive echoes are such measurements, and their cosine without much noise is
    `successive`. The level of the noise alone does not tell it: late echoes drown first, and how
    soon depends on the room.
    """
    if len(vectors) < 2 or successive <= 0 or not over_noise_db < QUIET_PHONE_DB:
        return 1.0
    alike = float(np.median(np.sum(vectors[1:] * vectors[:-1], axis=1)))
    reliability = min(alike / successive, 1.0)
    if reliability < NO_RELIABILITY:
        return 1.0
    return float(np.sqrt(max(reliability, LEAST_RELIABILITY)))


def walk_vectors(samples: F32, encoder: Encoder) -> F32:
    """Unit vectors (n, d) of a walk's traces (n, 2352), in their order; see `mean_normalised`."""
    return mean_normalised(encoder.embed(samples), encoder.still)


def mean_normalised(vectors: F32, still: float = STILL) -> F32:
    """Unit vectors (n, d) of a walk less the mean of those so far, made unit again.

    Loudspeaker and microphone colour every echo alike, and a mean over places has no place in it:
    this is the cepstral mean normalisation of speech recognition (Atal 1974), with a running mean.
    It goes by what was heard up to each echo alone, so that a phone that walks has the same. What
    is heard while the phone stands, cosine over `still` to STILL_ECHOES before, hardly counts:
    the mean would fill with that place.
    """
    counted = np.ones((len(vectors), 1))
    cosine = np.sum(vectors[STILL_ECHOES:] * vectors[:-STILL_ECHOES], axis=1)
    counted[STILL_ECHOES:, 0] = np.where(np.minimum(cosine, 1.0) <= still, 1.0, STILL_WEIGHT)
    common = np.cumsum(counted * vectors, axis=0) / (PRIOR_FRAMES + np.cumsum(counted, axis=0))
    own = vectors - common
    length = np.linalg.norm(own, axis=1, keepdims=True)
    return np.asarray(own / np.maximum(length, 1e-12), dtype=np.float32)
