"""An experiment for phyphox (RWTH Aachen) that plays our chirp and records everything.

What the parts mean is said in the app's description of its file format (phyphox.org/wiki). The
waveform of the output is one period, played in a loop; the sound is appended to a buffer of
fixed length, as the app allows no endless one there.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from elfslam.base.errors import ParameterError
from elfslam.stages.chirp import ChirpParameters, make_chirp

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
SENSORS = {
    "accelerometer": ("Accelerometer", "Acceleration", "m/s^2"),
    "gyroscope": ("Gyroscope", "Gyroscope", "rad/s"),
    "magnetic_field": ("Magnetometer", "Magnetic field", "µT"),
}
"""By the app's name: the set in which it is exported, its columns, their unit."""
OPTIONAL = ("magnetic_field", "attitude")
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
    """The samples of one period, as the file writes them."""
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
    for sensor in (*SENSORS, "attitude"):
        for component in _components(sensor):
            add(f"{sensor}_{component}", 0)


def _components(sensor: str) -> tuple[str, ...]:
    return ("t", "x", "y", "z", "abs") if sensor == "attitude" else ("t", "x", "y", "z")


def _input(given: ElementTree.Element) -> None:
    for sensor in (*SENSORS, "attitude"):
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
    for sensor, (name, quantity, unit) in SENSORS.items():
        columns = [f"{quantity} {axis} ({unit})" for axis in "xyz"]
        _set(export, name, sensor, ("Time (s)", *columns))
    _set(export, "Attitude", "attitude", QUATERNION_COLUMNS)
    for column, buffer in ((SOUND_COLUMN, "sound"), (RATE_COLUMN, "rate")):
        group = ElementTree.SubElement(export, "set", name=column.split(" (")[0])
        ElementTree.SubElement(group, "data", name=column).text = buffer


def _set(export: ElementTree.Element, name: str, sensor: str, columns: tuple[str, ...]) -> None:
    group = ElementTree.SubElement(export, "set", name=name)
    for component, column in zip(_components(sensor), columns, strict=True):
        ElementTree.SubElement(group, "data", name=column).text = f"{sensor}_{component}"
