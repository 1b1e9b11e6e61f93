"""Exports of phyphox (RWTH Aachen): a .zip with one CSV per set of buffers, and meta/.

Names stand in quotes, numbers as 1.2E0, and a shorter buffer is filled up with NaN. Times are
seconds of the experiment, which stands still while it is paused; meta/time.csv says when it was
started and paused. Sensors are told apart by the units in the names of their columns, which are
in the language of the phone, so that our own experiment, the app's and those of its users can be
read. Sound is a buffer of samples, in a set of its own, its rate in another.
"""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.values import Audio, Barometer, Imu, Magnetometer, Orientation, Recording
from elfslam.data import log_files, sensor_files
from elfslam.data.tables import cells_of, parse_rows, read_csv, read_lines, separator_of
from elfslam.stages.chirp import ACCEPTED_RATES_HZ, ChirpParameters, make_chirp

FORMAT_VERSION = "1.16"
"""The first that can append sound; phyphox 1.1.12."""
RATE_HZ = 48_000
ANALYSIS_SLEEP_S = 1.0
"""Older apps begin the loop anew each time they analyse, so that is done seldom."""
BYTES_PER_SAMPLE = 40
"""Of a buffer on Android: a linked list of boxed doubles."""
SOUND_COLUMN = "Sound"
RATE_COLUMN = "Sound rate (Hz)"
QUATERNION_COLUMNS = ("Attitude time (s)", "Attitude x", "Attitude y", "Attitude z", "Attitude w")
RECORDED = {
    "accelerometer": ("Accelerometer", "Acceleration", "m/s^2"),
    "gyroscope": ("Gyroscope", "Gyroscope", "rad/s"),
    "magnetic_field": ("Magnetometer", "Magnetic field", "µT"),
}
"""By the app's name: the set in which it is exported, its columns, their unit."""
ATTITUDE_SENSOR, PRESSURE_SENSOR = "attitude", "pressure"
SENSORS = (*RECORDED, ATTITUDE_SENSOR, PRESSURE_SENSOR)
OPTIONAL = ("magnetic_field", ATTITUDE_SENSOR, PRESSURE_SENSOR)
DESCRIPTION = """Record a walk for elfslam: chirps, echoes and motion.
Turn the media volume up, take off Bluetooth headsets, press play, walk, press pause.
Export as CSV and import it with: elfslam import phyphox FILE.zip OUT"""


def phyphox_experiment(parameters: ChirpParameters, minutes: float) -> bytes:
    """The experiment's XML; its sound buffer holds `minutes`. Raises ParameterError."""
    root = ElementTree.Element("phyphox", version=FORMAT_VERSION)
    for tag, text in (("title", "elfslam"), ("category", "elfslam"), ("description", DESCRIPTION)):
        ElementTree.SubElement(root, tag).text = text
    ElementTree.SubElement(root, "icon", format="string").text = "elf"
    _containers(root, _period(parameters), round(minutes * 60 * RATE_HZ))
    _input(ElementTree.SubElement(root, "input"))
    output = ElementTree.SubElement(root, "output")
    speaker = ElementTree.SubElement(output, "audio", rate=str(RATE_HZ), loop="true")
    ElementTree.SubElement(speaker, "input").text = "chirp"
    ElementTree.SubElement(root, "analysis", sleep=f"{ANALYSIS_SLEEP_S:g}")
    _views(ElementTree.SubElement(root, "views"), minutes)
    _export(ElementTree.SubElement(root, "export"))
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _period(parameters: ChirpParameters) -> str:
    chirp = make_chirp(parameters, RATE_HZ)
    count = parameters.period_s * RATE_HZ
    if abs(count - round(count)) > 1e-6:
        raise ParameterError(
            f"chirp.period_s: {parameters.period_s:g} s is {count:g} samples at {RATE_HZ} Hz, "
            "wanted a whole number; set 0.1"
        )
    samples = np.zeros(round(count))
    samples[: len(chirp.samples)] = chirp.samples
    return ",".join(f"{sample:.9g}" for sample in samples)


def _containers(root: ElementTree.Element, period: str, sound_samples: int) -> None:
    containers = ElementTree.SubElement(root, "data-containers")

    def add(name: str, size: int, init: dict[str, str] | None = None) -> None:
        attributes = {"size": str(size), **(init or {})}
        ElementTree.SubElement(containers, "container", attributes).text = name

    add("chirp", period.count(",") + 1, {"init": period})
    add("sound", sound_samples)
    add("rate", 1)
    for sensor in SENSORS:
        for component in _components(sensor):
            add(f"{sensor}_{component}", 0)


def _components(sensor: str) -> tuple[str, ...]:
    if sensor == PRESSURE_SENSOR:
        return ("t", "x")
    return ("t", "x", "y", "z", "abs") if sensor == ATTITUDE_SENSOR else ("t", "x", "y", "z")


def _input(given: ElementTree.Element) -> None:
    for sensor in SENSORS:
        attributes = {"type": sensor}
        if sensor in OPTIONAL:
            attributes["ignoreUnavailable"] = "true"
        element = ElementTree.SubElement(given, "sensor", attributes)
        for component in _components(sensor):
            output = ElementTree.SubElement(element, "output", component=component)
            output.text = f"{sensor}_{component}"
    microphone = ElementTree.SubElement(given, "audio", rate=str(RATE_HZ), append="true")
    ElementTree.SubElement(microphone, "output").text = "sound"
    ElementTree.SubElement(microphone, "output", component="rate").text = "rate"


def _views(views: ElementTree.Element, minutes: float) -> None:
    view = ElementTree.SubElement(views, "view", label="Walk")
    longest = f"Walk at most {minutes:g} minutes, then pause and export as CSV."
    ElementTree.SubElement(view, "info", label=longest)
    value = ElementTree.SubElement(view, "value", label="Recorded", precision="0", unit="s")
    ElementTree.SubElement(value, "input").text = "accelerometer_t"


def _export(export: ElementTree.Element) -> None:
    for sensor, (name, quantity, unit) in RECORDED.items():
        columns = [f"{quantity} {axis} ({unit})" for axis in "xyz"]
        _set(export, name, sensor, ("Time (s)", *columns))
    _set(export, "Attitude", ATTITUDE_SENSOR, QUATERNION_COLUMNS)
    _set(export, "Pressure", PRESSURE_SENSOR, ("Time (s)", "Pressure (hPa)"))
    for column, buffer in ((SOUND_COLUMN, "sound"), (RATE_COLUMN, "rate")):
        group = ElementTree.SubElement(export, "set", name=column.split(" (")[0])
        ElementTree.SubElement(group, "data", name=column).text = buffer


def _set(export: ElementTree.Element, name: str, sensor: str, columns: tuple[str, ...]) -> None:
    group = ElementTree.SubElement(export, "set", name=name)
    for component, column in zip(_components(sensor), columns, strict=True):
        ElementTree.SubElement(group, "data", name=column).text = f"{sensor}_{component}"


DEVICE, EVENTS = "device.csv", "time.csv"
"""The app's own files, in meta/."""
TIME = re.compile(".*[(\uff08]s[)\uff09]$")
AXIS = re.compile(r"(?<![a-z])([xyz])(?![a-z])", re.IGNORECASE)
ACCELERATION, GYROSCOPE, FIELD, ATTITUDE = "acceleration", "gyroscope", "field", "attitude"
PRESSURE, HECTOPASCAL = "pressure", re.compile(r"hPa|mbar")
MPS2 = 1.0
"""The unit of an acceleration as its columns state it: metres per second squared."""
UNITS = {
    ACCELERATION: (re.compile(r"m/s(\^2|²|2)"), sensor_files.LARGEST_ACCEL_MPS2),
    GYROSCOPE: (re.compile(r"rad/s"), sensor_files.LARGEST_TURN_RADPS),
    FIELD: (re.compile(r"[µμu]T"), sensor_files.LARGEST_FIELD_UT),
}
"""What tells a sensor's columns, and beyond what it cannot be believed."""
LEAST_SOUND_SHARE = 0.9
"""Of the motion; less means that the buffer of the sound ran over."""
RATE_SLACK = 0.01


@dataclass(frozen=True, eq=False)
class SensorTable:
    """One CSV: the names of its columns, and its numbers (rows, columns) with NaN at the end."""

    file: Path
    names: tuple[str, ...]
    numbers: F64


def read_phyphox(path: Path) -> log_files.Imported:
    """The recording in a .zip of CSVs, or in their folder, t = 0 where the experiment was started.

    Raises InputError naming what is missing or bad, for an export as Excel, and for an
    experiment that was paused and went on.
    """
    with log_files.log_folder(path) as folder:
        return _read_folder(folder, log_files.name_of(path))


def is_phyphox(columns: Sequence[str]) -> bool:
    """Whether the columns of a table are a time and what a sensor measures, in its unit."""
    measured = any(unit.search(name) for unit, _ in UNITS.values() for name in columns)
    return measured and any(map(TIME.match, columns))


def _read_folder(folder: Path, name: str) -> log_files.Imported:
    if (folder / "xl").is_dir():
        raise InputError(f"{folder}: is an Excel file; export as CSV, with any separator")
    files = log_files.one_of_each(folder, (".csv",))
    meta = {key: _meta(files.pop(key)) for key in (DEVICE, EVENTS) if key in files}
    _check_one_run(folder, meta.get(EVENTS, []))
    tables = [_read_table(file) for file in files.values()]
    accelerations, gyroscopes, fields = (_streams(tables, *each) for each in UNITS.values())
    if not accelerations or not gyroscopes:
        missing = "an accelerometer" if not accelerations else "a gyroscope"
        raise InputError(
            f"{folder}: has no columns of {missing}; wanted Time (s) and x, y, z in m/s^2 and "
            "rad/s; record with the experiment of `elfslam phyphox`"
        )
    read = {f"{ACCELERATION} {k}": stream for k, stream in enumerate(accelerations)}
    read |= {GYROSCOPE: gyroscopes[0]} | dict(zip([FIELD], fields, strict=False))
    if (attitude := _named(tables, QUATERNION_COLUMNS)) is not None and len(attitude):
        read[ATTITUDE] = attitude[:, 0], attitude[:, 1:]
    if (pressure := _pressure(tables)) is not None:
        read[PRESSURE] = pressure
    clock = log_files.clock_of(str(folder), accelerations[0][0])
    streams, damaged = log_files.on_one_clock(read, clock)
    accel = log_files.with_gravity(
        [streams[key] for key in streams if key.startswith(ACCELERATION)], MPS2
    )
    imu = sensor_files.imu_on_accelerometer_clock(str(folder), *accel, *streams[GYROSCOPE])
    recording = Recording(
        name=name,
        device=_device(meta.get(DEVICE, [])),
        audio=_sound(folder, tables, imu),
        imu=imu,
        orientation=_orientation(streams.get(ATTITUDE), imu),
        magnetometer=Magnetometer(*streams[FIELD]) if FIELD in streams else None,
        barometer=_barometer(streams.get(PRESSURE)),
        notes=clock.notes,
    )
    return log_files.Imported(recording, damaged_lines=damaged)


def _barometer(pressure: log_files.Stream | None) -> Barometer | None:
    return pressure and sensor_files.barometer_from(pressure[0], pressure[1][:, 0])


def _read_table(file: Path) -> SensorTable:
    text = read_csv(file)
    return SensorTable(file, text.names, _numbers(file, text.body, len(text.names)))


def _numbers(file: Path, body: str, columns: int) -> F64:
    if not body:
        return np.empty((0, columns))
    try:
        numbers = np.loadtxt(
            io.StringIO(body), delimiter=",", comments=None, ndmin=2, usecols=range(columns)
        )
    except (ValueError, IndexError):
        numbers = np.empty((0, columns))
    if len(numbers) != body.count("\n") + 1 or np.isinf(numbers).any():
        # It names the row; NaN is none of its business here.
        lines = [_without_nan(line) for line in body.splitlines()]
        parse_rows(file, lines, range(columns), first_row=2)
        raise InputError(f"{file}: cannot be read as numbers; export it again")
    return np.asarray(numbers, dtype=np.float64)


def _without_nan(line: str) -> str:
    return ",".join("0" if cell.strip().lower() == "nan" else cell for cell in line.split(","))


def _columns(table: SensorTable, wanted: Sequence[int]) -> F64:
    """Some columns, up to where all of them end. Raises InputError for NaN before that."""
    values = table.numbers[:, list(wanted)]
    whole = np.asarray(np.isfinite(values).all(axis=1))
    count = int(whole.sum())
    if not whole[:count].all():
        row = int(np.argmin(whole)) + 2
        raise InputError(
            f"{table.file}: row {row} has NaN in the middle of a column; export it again"
        )
    return np.asarray(values[:count])


def _streams(
    tables: Sequence[SensorTable], unit: re.Pattern[str], largest: float
) -> list[log_files.Stream]:
    """Times and values of every sensor that measures in a unit."""
    return [
        _stream(table, columns, largest)
        for table in tables
        for columns in _axes(table.names, unit)
        if len(_columns(table, columns)) > 1
    ]


def _stream(table: SensorTable, columns: Sequence[int], largest: float) -> log_files.Stream:
    values = _columns(table, columns)
    worst = float(np.abs(values[:, 1:]).max())
    if worst > largest:
        raise InputError(
            f"{table.file}: has {worst:g} in {table.names[columns[1]]}, wanted at most "
            f"{largest:g}; the file is damaged, export it again"
        )
    return values[:, 0], values[:, 1:]


def _axes(names: Sequence[str], unit: re.Pattern[str]) -> list[list[int]]:
    """Which columns hold the time and x, y, z in that unit: once for each sensor of a table."""
    times = [k for k, name in enumerate(names) if TIME.match(name)]
    axes: dict[str, list[int]] = {axis: [] for axis in "xyz"}
    for k, name in enumerate(names):
        if k not in times and unit.search(name) and (axis := AXIS.search(name)):
            axes[axis[1].lower()].append(k)
    return [[times[0], *xyz] for xyz in zip(*axes.values(), strict=False) if times]


def _named(tables: Sequence[SensorTable], names: Sequence[str]) -> F64 | None:
    for table in tables:
        if set(names) <= set(table.names):
            return _columns(table, [table.names.index(name) for name in names])
    return None


def _pressure(tables: Sequence[SensorTable]) -> log_files.Stream | None:
    """Times and pressure of the first table that has both, in the app's unit."""
    for table in tables:
        times = [k for k, name in enumerate(table.names) if TIME.match(name)]
        measured = [k for k, name in enumerate(table.names) if HECTOPASCAL.search(name)]
        if times and measured and len(values := _columns(table, [times[0], measured[0]])):
            return values[:, 0], values[:, 1:]
    return None


def _sound(folder: Path, tables: Sequence[SensorTable], imu: Imu) -> Audio | None:
    """The buffer of our experiment. Raises InputError where it ran over, or for another rate."""
    samples, rates = _named(tables, [SOUND_COLUMN]), _named(tables, [RATE_COLUMN])
    if samples is None or not len(samples):
        return None
    said_hz = float(rates[-1, 0]) if rates is not None and len(rates) else 0.0
    nearest = min(ACCEPTED_RATES_HZ, key=lambda rate_hz: abs(rate_hz - said_hz))
    if abs(said_hz - nearest) > RATE_SLACK * nearest:
        raise InputError(
            f"{folder}: the sound was recorded at {said_hz:g} samples/s, wanted "
            f"{' or '.join(map(str, ACCEPTED_RATES_HZ))}; this phone cannot be used"
        )
    duration_s, moved_s = len(samples) / nearest, float(imu.t_s[-1])
    if duration_s < LEAST_SOUND_SHARE * moved_s:
        raise InputError(
            f"{folder}: {duration_s:.0f} s of sound for {moved_s:.0f} s of motion; its buffer ran "
            "over: walk shorter, or make an experiment for more minutes",
            argument="minutes",
        )
    return Audio(np.clip(samples.T, -1, 1), nearest)


def _orientation(attitude: log_files.Stream | None, imu: Imu) -> Orientation | None:
    return attitude and log_files.attitude_that_agrees(attitude[0], [attitude[1]], imu)


def _meta(file: Path) -> list[list[str]]:
    lines = read_lines(file)
    return [cells_of(file, line, separator_of(lines[0])) for line in lines[1:]]


def _device(rows: Sequence[Sequence[str]]) -> str:
    facts = {row[0]: row[1] for row in rows if len(row) > 1}
    names = [facts.get(key, "") for key in ("deviceBrand", "deviceModel")]
    return " ".join(name for name in names if name) or "unknown"


def _check_one_run(folder: Path, rows: Sequence[Sequence[str]]) -> None:
    """Refuse an experiment that went on after a pause: its clock stood still."""
    events = [row[0].strip().upper() for row in rows if row]
    if events.count("START") > 1:
        raise InputError(
            f"{folder}: the experiment was started {events.count('START')} times, wanted one run "
            "without a pause; clear the data before each walk"
        )
