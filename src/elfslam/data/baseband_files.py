"""The chirp band on disk: baseband.iq, baseband.csv, and its format in recording.json."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.base.bounds import check_claim
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_bytes
from elfslam.data.baseband import Baseband, BasebandFormat
from elfslam.data.tables import read_header, read_timed_table
from elfslam.stages.chirp import ACCEPTED_RATES_HZ

IQ, FRAME_TIMES = "baseband.iq", "baseband.csv"
BYTES = 4
"""Of one sample: I and Q, little-endian 16 bits each."""
SAMPLE_BYTES = 4
"""Of the sound that is made of it."""
LIMITS = {
    "rate_hz": (5000, 24_000),
    "centre_hz": (10_000, 22_000),
    "frame_samples": (1, 24_000),
    "scale": (1e-12, 1.0),
    "source_rate_hz": (min(ACCEPTED_RATES_HZ), max(ACCEPTED_RATES_HZ)),
    "lead_s": (0, 1),
}
"""What recording.json must say, and between which values it is believed."""
WHOLE = ("rate_hz", "frame_samples", "source_rate_hz")
SPARSEST_FRAMES = 0.01
"""Frames that fill less of their time line than this carry times in another unit."""
OFF_GRID = 0.01
"""Of a sample; nine decimals of a second are within 1e-4."""


def write_baseband(baseband: Baseband, folder: Path) -> dict[str, object]:
    """Both files into `folder`; gives what recording.json says under "baseband"."""
    (folder / IQ).write_bytes(baseband.iq.astype("<i2").tobytes())
    pairs = zip(baseband.t_s, baseband.scale.tolist(), strict=True)
    rows = "".join(f"{t_s:.9f},{scale!r}\n" for t_s, scale in pairs)
    (folder / FRAME_TIMES).write_text("t_s,scale\n" + rows, encoding="utf-8")
    return asdict(baseband.kept)


def read_baseband(folder: Path, described: object) -> Baseband:
    """The frames of a folder; `described` is recording.json's "baseband". Raises InputError."""
    kept = _format(folder / "recording.json", described)
    t_s, scale = _times_and_scales(folder / FRAME_TIMES, kept)
    first = _on_grid(folder / FRAME_TIMES, t_s, kept)
    wanted = len(t_s) * kept.frame_samples * BYTES
    content = read_bytes(folder / IQ)
    if len(content) != wanted:
        raise InputError(
            f"{folder / IQ}: has {len(content)} bytes, wanted {wanted} for {len(t_s)} frames of "
            f"{kept.frame_samples} samples in {FRAME_TIMES}; copy both again"
        )
    samples = t_s[-1] * kept.source_rate_hz
    check_claim(folder / FRAME_TIMES, "its last time", samples * SAMPLE_BYTES, len(content))
    iq = np.frombuffer(content, dtype="<i2").reshape(len(t_s), kept.frame_samples, 2)
    return Baseband(first, iq.astype(np.int16), scale, kept)


def _times_and_scales(file: Path, kept: BasebandFormat) -> tuple[F64, F64]:
    """When each frame begins, and its scale: that of its row, else the one for all."""
    if "scale" not in read_header(file):
        t_s, _ = read_timed_table(file, [])
        return t_s, np.full(len(t_s), kept.scale)
    t_s, values = read_timed_table(file, ["scale"])
    low, high = LIMITS["scale"]
    beyond = np.flatnonzero((values[:, 0] < low) | (values[:, 0] > high))
    if len(beyond):
        row, got = beyond[0] + 2, values[beyond[0], 0]
        raise InputError(
            f"{file}: row {row} has scale {got:g}, wanted {low:g} to {high:g}; repair it"
        )
    return t_s, values[:, 0]


def _on_grid(file: Path, t_s: F64, kept: BasebandFormat) -> I64:
    """The index of each frame's first sample on the grid of the rate."""
    filled_s = len(t_s) * kept.frame_samples / kept.rate_hz
    if t_s[0] < 0 or filled_s < SPARSEST_FRAMES * t_s[-1]:
        raise InputError(
            f"{file}: {len(t_s)} frames from {t_s[0]:g} to {t_s[-1]:g} s; wanted seconds from 0 on"
        )
    first = np.round(t_s * kept.rate_hz)
    off = np.flatnonzero(np.abs(t_s * kept.rate_hz - first) > OFF_GRID)
    if len(off):
        raise InputError(
            f"{file}: row {off[0] + 2} has {t_s[off[0]]:.9f} s, wanted a multiple of "
            f"1/{kept.rate_hz} s; write nine decimals"
        )
    return first.astype(np.int64)


def _format(file: Path, described: object) -> BasebandFormat:
    """What recording.json says of the baseband, checked."""
    if not isinstance(described, dict):
        raise InputError(f"{file}: baseband is {described!r:.60}, wanted how {IQ} was made")
    said = {name: _number(file, name, described.get(name)) for name in LIMITS}
    made = BasebandFormat(
        rate_hz=int(said["rate_hz"]),
        centre_hz=said["centre_hz"],
        frame_samples=int(said["frame_samples"]),
        scale=said["scale"],
        source_rate_hz=int(said["source_rate_hz"]),
        lead_s=said["lead_s"],
    )
    if made.source_rate_hz not in ACCEPTED_RATES_HZ:
        wanted = " or ".join(map(str, ACCEPTED_RATES_HZ))
        got = made.source_rate_hz
        raise InputError(f"{file}: baseband.source_rate_hz is {got}, wanted {wanted}; repair it")
    return made


def _number(file: Path, name: str, given: object) -> float:
    (low, high), whole = LIMITS[name], name in WHOLE
    if isinstance(given, int | float) and not isinstance(given, bool) and low <= given <= high:
        number = float(given)
        if number.is_integer() or not whole:
            return number
    kind = "a whole number" if whole else "a number"
    raise InputError(
        f"{file}: baseband.{name} is {given!r:.40}, wanted {kind} from {low:g} to {high:g}; "
        "repair it"
    )
