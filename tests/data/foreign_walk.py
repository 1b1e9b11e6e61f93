"""One short walk as other programs write it: what their users do to such files, one kind each."""

import io
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.data.importing import read_logs, recognise
from elfslam.data.log_files import Imported

T_S = np.arange(1200) * 0.01
"""Twelve seconds, with 1.7 steps in each and a slow sway."""
BEAT = 3.0 * np.sin(3.4 * np.pi * T_S) + np.sin(0.6 * np.pi * T_S)
PUSH = BEAT[:, None] * np.array([0.2, 0.4, 0.9])
UP = np.array([0.1, 4.9, 8.5])
ACCEL_MPS2, TURN_RADPS = UP + PUSH, 0.1 * np.cos(T_S)[:, None] * np.array([0.1, 0.2, 1.0])
EPOCH_NS = 1_764_000_000_000_000_000
Files = Mapping[str, str]


def sensorlogger(t_s: F64 = T_S) -> dict[str, str]:
    def table(values: F64) -> str:
        rows = [
            f"{EPOCH_NS + round(t * 1e9)},{t:.6f}," + ",".join(f"{v:.6f}" for v in row[::-1])
            for t, row in zip(t_s, values, strict=True)
        ]
        return "\n".join(["time,seconds_elapsed,z,y,x", *rows]) + "\n"

    facts = "device name,platform,standardisation\nphone,android,true\n"
    return {
        "TotalAcceleration.csv": table(ACCEL_MPS2),
        "Gyroscope.csv": table(TURN_RADPS),
        "Metadata.csv": facts,
    }


def phyphox(*accelerations: tuple[str, str, F64]) -> dict[str, str]:
    """Tables of accelerations by file, quantity and values, with their gyroscope."""

    def table(quantity: str, unit: str, values: F64) -> str:
        head = ",".join(['"t (s)"', *(f'"{quantity} {axis} ({unit})"' for axis in "xyz")])
        rows = [",".join(f"{v:.6E}" for v in (t, *row)) for t, row in zip(T_S, values, strict=True)]
        return "\n".join([head, *rows]) + "\n"

    made = {f"{name}.csv": table(quantity, "m/s²", each) for name, quantity, each in accelerations}
    return {**made, "Gyroscope.csv": table("Gyroscope", "rad/s", TURN_RADPS)}


def ronin() -> dict[str, str]:
    def table(values: F64) -> str:
        content = io.StringIO()
        np.savetxt(content, np.column_stack([EPOCH_NS + T_S * 1e9, values]))
        return content.getvalue()

    return {"acce.txt": table(ACCEL_MPS2), "gyro.txt": table(TURN_RADPS)}


def put_back(seconds: float) -> dict[str, str]:
    return sensorlogger(T_S - seconds * (T_S >= 8))


def decimal_commas(files: Files) -> dict[str, str]:
    return {
        name: "\ufeff" + text.replace(",", ";").replace(".", ",").replace("\n", "\r\n")
        for name, text in files.items()
    }


def annotated() -> dict[str, str]:
    taps = 'seconds_elapsed,text\n2.0,door\n6.0,"1.5, 2"\n10.0,door\n'
    return {**sensorlogger(), "Annotation.csv": taps}


LINEAR = ("Accélération linéaire", "Accélération linéaire", PUSH)
WHOLE = ("Accéléromètre", "Accélération selon", ACCEL_MPS2)
READ = "sensorlogger, 1200 rows, 0 damaged, 0 notes"
CASES: Mapping[str, tuple[Callable[[], Files], str]] = {
    "as it is": (sensorlogger, READ),
    "saved by a spreadsheet": (lambda: decimal_commas(sensorlogger()), READ),
    "clock put back": (lambda: put_back(3600), READ.replace("0 notes", "1 notes")),
    "clock put forward": (lambda: put_back(-3600), READ.replace("0 notes", "1 notes")),
    "taps": (annotated, READ.replace("0 notes", "1 notes, 3 checkpoints")),
    "packed by Windows": (
        lambda: {f"my walk\\{name}": text for name, text in sensorlogger().items()},
        READ,
    ),
    "with and without gravity": (
        lambda: phyphox(LINEAR, WHOLE),
        READ.replace("sensorlogger", "phyphox"),
    ),
    "without gravity, gentle": (
        lambda: phyphox(("A", "Accelerazione", 0.4 * PUSH)),
        "refused: gravity is missing",
    ),
    "without gravity, wild": (
        lambda: phyphox(("A", "加速度", 6 * PUSH)),
        "refused: gravity is missing",
    ),
    "numpy.savetxt": (ronin, READ.replace("sensorlogger", "ronin")),
}
"""What is done to a walk, and what is wanted of it."""


def packed(files: Files, path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def told(path: Path) -> tuple[str, Imported | None]:
    """What `elfslam import auto` makes of a log, in a line, and the recording if there is one."""
    try:
        known = recognise(path)
        assert known is not None
        (item,) = read_logs(known, path, np.random.default_rng(0))
    except InputError as refused:
        return f"refused: {str(refused).removeprefix(f'{path}: ').split(':')[0]}", None
    recording = item.recording
    line = f"{known}, {len(recording.imu.t_s)} rows, {item.damaged_lines} damaged, "
    line += f"{len(recording.notes)} notes"
    taps = recording.checkpoints
    return line + (f", {len(taps.t_s)} checkpoints" if taps else ""), item
