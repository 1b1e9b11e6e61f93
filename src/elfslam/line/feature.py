"""Features: an encoder turns each echo trace into a unit vector, row by row."""

from __future__ import annotations

import hashlib
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE, Echoes, Features

WINDOW_SAMPLES = 96
HOP_SAMPLES = 48
FIRST_BIN = 33
BINS = 12
"""Bins 33 to 44 of a 96-point window at 44.1 kHz: 15.2 to 20.2 kHz."""


class Encoder(Protocol):
    """Echo traces in, unit vectors out, each row by itself."""

    @property
    def identity(self) -> str:
        """What must be equal for two features to be comparable."""
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

    def embed(self, samples: F32) -> F32:
        """Unit vectors (n, 576)."""
        level = np.log(spectrogram(samples) + 1e-7)
        level -= level.mean(axis=2, keepdims=True)
        time = np.linspace(-1.0, 1.0, level.shape[2], dtype=np.float32)
        slope = (level * time).sum(axis=2, keepdims=True) / (time**2).sum()
        flat = (level - slope * time).reshape(len(samples), -1)
        return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12))


class OnnxEncoder:
    """One ONNX graph from raw aligned samples (n, 2352) to the ELF (n, 128).

    Raises InputError where the file is missing or is not such a graph.
    """

    def __init__(self, content: bytes, name: str) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.log_severity_level = 3
        self.content = content
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

    def embed(self, samples: F32) -> F32:
        """Unit vectors (n, 128)."""
        if len(samples) == 0:
            return np.zeros((0, ELF_SIZE), dtype=np.float32)
        parts = [
            self._session.run(["elf"], {"samples": np.ascontiguousarray(samples[k : k + 256])})[0]
            for k in range(0, len(samples), 256)
        ]
        return np.concatenate(parts)


def load_encoder(name: str) -> Encoder:
    """The encoder called `name`: "compact" (shipped), "spectral" (no learning) or an ONNX file."""
    if name == "spectral":
        return SpectralEncoder()
    if name == "compact":
        content = resources.files("elfslam").joinpath("weights/compact.onnx").read_bytes()
        return OnnxEncoder(content, name)
    try:
        content = Path(name).read_bytes()
    except OSError as cause:
        raise InputError(
            f"encoder {name!r}: wanted compact, spectral or an ONNX file; no such file"
        ) from cause
    return OnnxEncoder(content, name)


def extract_features(echoes: Echoes, encoder: Encoder) -> Features:
    """The feature of every echo."""
    return Features(echoes.t_s, encoder.embed(echoes.samples), encoder.identity)
