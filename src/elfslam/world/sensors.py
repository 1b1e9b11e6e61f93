"""Sensors beside sound and motion: what a world's description says of them, what a walk reads."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any, TypedDict, TypeVar

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Barometer, Emr, Magnetometer, WifiScans
from elfslam.world import magnetic
from elfslam.world.barometer import read_barometer
from elfslam.world.room import Room
from elfslam.world.toml_tables import LARGEST_M
from elfslam.world.walker import Motion
from elfslam.world.wifi import AccessPoint, WifiParameters, channel_mhz, scan

Element = TypeVar("Element")
LARGEST = 1e6
"""Of a number in any unit."""
MOST_HARMONICS = 100


class Sensor(StrEnum):
    """What a simulated phone can bring besides sound and motion."""

    WIFI = "wifi"
    MAGNETIC = "magnetic"
    EMR = "emr"
    BAROMETER = "barometer"


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What a place has for those sensors; `seed` makes its shadows and phases its own."""

    walls_m: F64
    seed: int
    access_points: tuple[AccessPoint, ...] = ()
    field: magnetic.MagneticField | None = None
    power_lines: tuple[magnetic.PowerLine, ...] = ()
    entrances_m: F64 | None = None


class Readings(TypedDict, total=False):
    """Fields of a Recording."""

    wifi: WifiScans | None
    magnetometer: Magnetometer
    emr: Emr
    barometer: Barometer


def parse_sensors(text: str) -> frozenset[Sensor]:
    """Sensors from "wifi,magnetic". Raises InputError for another name."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    wrong = [name for name in names if name not in list(Sensor)]
    if wrong:
        raise InputError(f"sensor {wrong[0]!r}: wanted {', '.join(Sensor)}; correct the name")
    return frozenset(map(Sensor, names))


def read_surroundings(table: Mapping[str, Any], room: Room, seed: int) -> Surroundings:
    """The `[[access_point]]`, `[magnetic]` and `[[power_line]]` tables of a world.

    Raises InputError that names the element.
    """
    points = _elements(table, "access_point", "bssid", AccessPoint, _check_access_point)
    lines = _elements(table, "power_line", "name", magnetic.PowerLine, _check_power_line)
    field = None
    if "magnetic" in table:
        magnetism = _made("magnetic", table["magnetic"], magnetic.Magnetism, _check_magnetism)
        field = magnetic.magnetic_field(room, magnetism, np.random.default_rng([seed, 13]))
    outline = room.outline_m
    walls_m = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    return Surroundings(walls_m, seed, points, field, lines)


def sense(
    around: Surroundings,
    motion: Motion,
    seed: int,
    sensors: Collection[Sensor],
    wifi: WifiParameters,
) -> Readings:
    """What each sensor reads along a walk; each has its own noise, whichever others there are.

    Raises InputError where the place has nothing for a sensor.
    """
    readings: Readings = {}
    if Sensor.WIFI in sensors:
        _check_present(around.access_points, Sensor.WIFI, "[[access_point]]")
        generator = np.random.default_rng([seed, 2])
        readings["wifi"] = scan(
            motion, around.access_points, around.walls_m, around.seed, generator, wifi
        )
    if Sensor.MAGNETIC in sensors:
        _check_present(around.field, Sensor.MAGNETIC, "[magnetic]")
        assert around.field is not None
        generator = np.random.default_rng([seed, 3])
        readings["magnetometer"] = magnetic.read_magnetometer(
            motion, around.field, magnetic.AK09911, generator
        )
    if Sensor.EMR in sensors:
        _check_present(around.power_lines, Sensor.EMR, "[[power_line]]")
        generator = np.random.default_rng([seed, 4])
        readings["emr"] = magnetic.listen_to_mains(
            motion, around.power_lines, around.seed, generator, magnetic.MainsParameters()
        )
    if Sensor.BAROMETER in sensors:
        generator = np.random.default_rng([seed, 51])
        readings["barometer"] = read_barometer(motion, generator, (), around.entrances_m)
    return readings


def _check_present(what: object, sensor: Sensor, table: str) -> None:
    if not what:
        raise InputError(f"sensor {sensor}: the world has no {table}; add one or leave it out")


def _elements(
    table: Mapping[str, Any],
    kind: str,
    name: str,
    make: type[Element],
    check: Callable[[Element], None],
) -> tuple[Element, ...]:
    rows = table.get(kind, [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{kind}: wanted [[{kind}]] tables, got {rows!r:.40}; double the brackets")
    labels = [f"{kind} {row.get(name, k + 1)!r}" for k, row in enumerate(rows)]
    for label, times in Counter(labels).items():
        if times > 1:
            raise InputError(f"{label:.80}: appears twice; give each its own {name}")
    return tuple(_made(label, row, make, check) for label, row in zip(labels, rows, strict=True))


def _made(
    label: str, row: Mapping[str, Any], make: type[Element], check: Callable[[Element], None]
) -> Element:
    if not isinstance(row, dict):
        raise InputError(f"{label}: wanted a [{label}] table, got {row!r:.40}; correct it")
    known = [item.name for item in fields(make)]  # type: ignore[arg-type]
    for name in row:
        if name not in known:
            raise InputError(f"{label}: knows no {name!r:.60}; wanted {', '.join(known)}")
    try:
        made = make(**row)
        check(made)
    except (TypeError, ValueError, InputError) as cause:
        raise InputError(f"{label}: {cause}") from cause
    return made


def _check_number(name: str, value: object, low: float = -LARGEST) -> None:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not low <= float(value) <= LARGEST:  # type: ignore[arg-type]
        raise InputError(
            f"{name} is {value!r:.40}, wanted a number from {low:g} to {LARGEST:g}; correct it"
        )


def _check_access_point(point: AccessPoint) -> None:
    _check_name("bssid", point.bssid)
    _check_place(point.position_m)
    _check_number("power_dbm", point.power_dbm)
    _check_number("channel", point.channel)
    channel_mhz(point.channel)


def _check_place(*points_m: F64) -> None:
    if max(float(np.abs(point).max()) for point in points_m) > LARGEST_M:
        raise InputError(f"lies beyond {LARGEST_M:g} m; correct its position")


def _check_name(name: str, value: object) -> None:
    if not isinstance(value, str) or not value or "," in value:
        raise InputError(f"{name} is {value!r:.40}, wanted a name without commas; correct it")


def _check_power_line(line: magnetic.PowerLine) -> None:
    _check_name("name", line.name)
    _check_place(line.from_m, line.to_m)
    if np.linalg.norm(line.to_m - line.from_m) < 0.01:
        raise InputError("begins where it ends; move one end")
    current_a = line.current_a
    if not 0 < len(current_a) <= MOST_HARMONICS or not (current_a >= 0).all():
        raise InputError(
            f"current_a has to be amplitudes from 0, one to {MOST_HARMONICS} of them; correct it"
        )
    _check_number("current_a", float(current_a.max()))


def _check_magnetism(magnetism: magnetic.Magnetism) -> None:
    for item in fields(magnetism):
        angle = item.name.endswith("_deg")
        _check_number(item.name, getattr(magnetism, item.name), -LARGEST if angle else 0.0)
