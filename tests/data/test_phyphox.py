"""Exports of phyphox, written as the app writes them, in each of its five ways."""

import re
import zipfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elfslam.base.errors import InputError
from elfslam.base.geometry import rotation_from_quaternion
from elfslam.data.phyphox import QUATERNION_COLUMNS, phyphox_experiment, read_phyphox
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import EchoParameters, cut_echoes

VARIANTS = [(",", "."), ("\t", "."), (";", "."), ("\t", ","), (";", ",")]
COMMA = VARIANTS[0]
T_S = np.arange(60) * 0.05
TILT = 0.4
UP = np.array([0.0, np.sin(TILT), np.cos(TILT)])
WORLD_FROM_PHONE = np.array([np.sin(TILT / 2), 0, 0, np.cos(TILT / 2)])
Variant = tuple[str, str]
Column = tuple[str, Sequence[float] | np.ndarray]


def number(value: float, point: str) -> str:
    """As Java's DecimalFormat "0.000000000E0" writes it."""
    if np.isnan(value):
        return "NaN"
    mantissa, exponent = f"{value:.9E}".split("E")
    return f"{mantissa}E{int(exponent)}".replace(".", point)


def table(columns: Sequence[Column], variant: Variant = COMMA) -> str:
    separator, point = variant
    rows = max(len(values) for _, values in columns)
    padded = [[*values, *[np.nan] * (rows - len(values))] for _, values in columns]
    lines = [separator.join(number(at, point) for at in row) for row in zip(*padded, strict=True)]
    return "\n".join([separator.join(f'"{name}"' for name, _ in columns), *lines]) + "\n"


def sensor(quantity: str, unit: str, values: np.ndarray) -> list[Column]:
    rows = np.broadcast_to(values, (len(T_S), 3))
    axes = [(f"{quantity} {axis} ({unit})", rows[:, k]) for k, axis in enumerate("xyz")]
    return [("Time (s)", T_S), *axes]


def times(events: Sequence[tuple[str, float]], variant: Variant = COMMA) -> str:
    separator, point = variant
    rows = ['"event" "experiment time" "system time" "system time text"'.replace('" "', '"|"')]
    for name, at_s in events:
        system = f"{1.7e9 + at_s:.3f}".replace(".", point)
        rows.append(f'"{name}"|{number(at_s, point)}|{system}|"2023-11-14 22:13:20.000 UTC+01:00"')
    return "\n".join(rows).replace("|", separator) + "\n"


def files(variant: Variant = COMMA) -> dict[str, str]:
    """What an export of our experiment holds."""
    sound = {"Sound.csv": sound_table(variant)}
    rate = {"Sound rate.csv": table([("Sound rate (Hz)", [48_000.0])], variant)}
    return {**silent_files(variant), **sound, **rate}


@cache
def sound_table(variant: Variant) -> str:
    return table([("Sound", SOUND)], variant)


def silent_files(variant: Variant = COMMA) -> dict[str, str]:
    attitude = zip(QUATERNION_COLUMNS, [T_S, *np.tile(WORLD_FROM_PHONE, (60, 1)).T], strict=True)
    facts = (
        '"property"|"value"\n"version"|"1.2.0"\n"deviceModel"|"Pixel 9a"\n"deviceBrand"|"Google"\n'
    )
    return {
        "Accelerometer.csv": table(sensor("Acceleration", "m/s^2", 9.81 * UP), variant),
        "Gyroscope.csv": table(sensor("Gyroscope", "rad/s", np.array([0.1, -0.2, 0.3])), variant),
        "Magnetometer.csv": table(
            sensor("Magnetic field", "µT", np.array([10.0, 20, -30])), variant
        ),
        "Attitude.csv": table(list(attitude), variant),
        "meta/device.csv": facts.replace("|", variant[0]),
        "meta/time.csv": times([("START", 0.0), ("PAUSE", 3.0)], variant),
    }


def played_in_a_room(seconds: float) -> np.ndarray:
    """The experiment's own waveform in a loop, with a direct path and one echo at 25 ms."""
    period = waveform(phyphox_experiment(ChirpParameters(), 1.0))
    heard = np.roll(np.tile(period, round(seconds * 10)), 700) * 0.3
    return heard + 0.1 * np.roll(heard, 1200)


def waveform(experiment: bytes) -> np.ndarray:
    every = ElementTree.fromstring(experiment).iter("container")
    container = next(each for each in every if each.text == "chirp")
    return np.array([float(cell) for cell in container.get("init", "").split(",")])


SOUND = played_in_a_room(3.0)


def export(folder: Path, content: dict[str, str]) -> Path:
    with zipfile.ZipFile(folder / "walk.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in content.items():
            archive.writestr(name, text)
    return folder / "walk.zip"


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_way_to_write_it_gives_the_same(tmp_path: Path, variant: Variant) -> None:
    recording = read_phyphox(export(tmp_path, files(variant))).recording
    assert (recording.name, recording.device) == ("walk", "Google Pixel 9a")
    np.testing.assert_allclose(recording.imu.t_s, T_S, atol=1e-9)
    np.testing.assert_allclose(recording.imu.accel_mps2[7], 9.81 * UP, rtol=1e-9)
    np.testing.assert_allclose(recording.imu.gyro_radps[7], [0.1, -0.2, 0.3])
    np.testing.assert_allclose(recording.magnetometer.field_ut[7], [10, 20, -30])
    attitude = recording.orientation.world_from_phone[0]
    np.testing.assert_allclose(rotation_from_quaternion(attitude) @ UP, [0, 0, 1], atol=1e-6)
    assert recording.audio.rate_hz == 48_000
    np.testing.assert_allclose(recording.audio.samples[0], SOUND, atol=1e-7)


def test_the_chirps_of_the_experiment_are_heard_in_its_export(tmp_path: Path) -> None:
    audio = read_phyphox(export(tmp_path, files())).recording.audio
    echoes = cut_echoes(audio, make_chirp(ChirpParameters(), 48_000), EchoParameters())
    assert len(echoes.t_s) >= 28
    np.testing.assert_allclose(np.diff(echoes.t_s), 0.1, atol=1e-4)
    first = np.abs(echoes.samples[3][: round(0.02 * 44_100)])
    assert 0.012 < np.argmax(first) / 44_100 < 0.024  # 25 ms less the 11 that are cut off


@pytest.mark.parametrize(
    "names",
    [
        ("Acceleration x (m/s^2)", "Gyroscope x (rad/s)"),
        ("X (m/s^2)", "X (rad/s)"),
        ("Beschleunigung x (m/s²)", "Gyroskop x (rad/s)"),
    ],
)
def test_exports_of_other_experiments_are_read(tmp_path: Path, names: tuple[str, str]) -> None:
    content = {}
    for file, name, value in zip(("Raw Data", "Turn"), names, (9.81 * UP, 0 * UP), strict=True):
        quantity, axis = re.fullmatch(r"(.*)\b[xX](.*)", name).groups()
        columns = [(f"{quantity}{x}{axis}", np.full(60, value[k])) for k, x in enumerate("xyz")]
        content[f"{file}.csv"] = table([("Time (s)", T_S), *columns, ("Absolute", T_S)])
    recording = read_phyphox(export(tmp_path, content)).recording
    np.testing.assert_allclose(recording.imu.accel_mps2[0], 9.81 * UP, rtol=1e-6)
    assert recording.device == "unknown"
    assert recording.audio is None
    assert recording.magnetometer is None


def without(name: str) -> dict[str, str]:
    return {key: text for key, text in files().items() if key != name}


def changed(name: str, text: str) -> dict[str, str]:
    return {**files(), name: text}


def in_the_middle(cell: str) -> str:
    lines = files()["Gyroscope.csv"].splitlines()
    lines[5] = ",".join([*lines[5].split(",")[:3], cell])
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (lambda: without("Gyroscope.csv"), "has no columns of a gyroscope"),
        (lambda: changed("Gyroscope.csv", in_the_middle("NaN")), r"Gyroscope\.csv: row 6 has NaN"),
        (lambda: changed("Gyroscope.csv", in_the_middle("1e9")), r"has 1e\+09 in Gyroscope"),
        (lambda: changed("Gyroscope.csv", files()["Gyroscope.csv"][:-30]), "row 61 has"),
        (lambda: changed("Gyroscope.csv", ""), "is empty"),
        (
            lambda: changed("Sound rate.csv", table([("Sound rate (Hz)", [16_000.0])])),
            "recorded at 16000 samples/s, wanted 44100 or 48000",
        ),
        (lambda: without("Sound rate.csv"), "recorded at 0 samples/s"),
        (lambda: changed("Sound.csv", table([("Sound", SOUND[:48_000])])), "its buffer ran over"),
        (
            lambda: changed(
                "meta/time.csv", times([("START", 0), ("PAUSE", 1), ("START", 1), ("PAUSE", 3)])
            ),
            "started 2 times, wanted one run",
        ),
        (lambda: {"xl/workbook.xml": "", "[Content_Types].xml": ""}, "is an Excel file"),
        (lambda: {}, "has no columns of an accelerometer"),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path: Path, content, says: str) -> None:
    with pytest.raises(InputError, match=says) as refusal:
        read_phyphox(export(tmp_path, content()))
    assert str(refusal.value).startswith(str(tmp_path / "walk.zip"))
    assert "\n" not in str(refusal.value)


@settings(max_examples=25, deadline=None)
@given(
    values=st.lists(
        st.tuples(*[st.floats(-99, 99, allow_subnormal=False)] * 3), min_size=2, max_size=20
    ),
    variant=st.sampled_from(VARIANTS),
    lacking=st.integers(0, 3),
)
def test_numbers_come_back_whatever_the_variant(
    tmp_path_factory: pytest.TempPathFactory,
    values: list[tuple[float, float, float]],
    variant: Variant,
    lacking: int,
) -> None:
    """What is written with nine decimals is read with nine; NaN at the end is left out."""
    field = np.array(values)
    t_s = np.arange(len(field)) * 0.1
    axes = [(f"Field {x} (µT)", [*field[:, k], *[np.nan] * lacking]) for k, x in enumerate("xyz")]
    text = table([("Time (s)", [*t_s, *[9.0] * lacking]), *axes], variant)
    folder = tmp_path_factory.mktemp("export")
    content = {**silent_files(variant), "Magnetometer.csv": text}
    read = read_phyphox(export(folder, content)).recording.magnetometer
    np.testing.assert_allclose(read.t_s, t_s, atol=1e-9)
    np.testing.assert_allclose(read.field_ut, field, rtol=1e-9, atol=1e-300)


def test_the_experiment_holds_the_chirp_and_the_period() -> None:
    root = ElementTree.fromstring(phyphox_experiment(ChirpParameters(), 2.0))
    chirp = make_chirp(ChirpParameters(), 48_000).samples
    played = waveform(ElementTree.tostring(root))
    np.testing.assert_array_equal(played[: len(chirp)].astype(np.float32), chirp)
    assert not played[len(chirp) :].any()
    speaker, microphone = root.find("output/audio"), root.find("input/audio")
    assert len(played) / int(speaker.get("rate", 0)) == ChirpParameters().period_s
    assert speaker.get("loop") == "true"
    assert speaker.findtext("input") == "chirp"
    assert microphone.get("rate") == "48000"
    assert microphone.get("append") == "true"


def test_every_buffer_of_the_experiment_is_declared_and_exported() -> None:
    root = ElementTree.fromstring(phyphox_experiment(ChirpParameters(), 2.0))
    declared = {each.text: int(each.get("size", 1)) for each in root.iter("container")}
    filled = {each.text for each in root.iter("output") if each.text and each.text.strip()}
    assert filled == set(declared) - {"chirp"}
    assert {each.text for each in root.iter("data")} == filled
    assert declared["chirp"] == 4800
    assert declared["sound"] == 2 * 60 * 48_000
    assert declared["accelerometer_x"] == 0  # grows without end
    assert float(root.get("version", 0)) >= 1.16
    kinds = {each.get("type") for each in root.iter("sensor")}
    assert kinds == {"accelerometer", "gyroscope", "magnetic_field", "attitude", "pressure"}
    assert all(each.get("rate") is None for each in root.iter("sensor"))  # as fast as they go


LANGUAGES = {
    "French": ("Temps (s)", "Accéléromètre", "Accélération selon", "Accélération linéaire"),
    "Japanese": ("時間 (s)", "加速度計", "加速度", "線形加速度"),
    "German": ("Zeit (s)", "Beschleunigungssensor", "Beschleunigung", "Lineare Beschleunigung"),
}


def stepping(gravity: np.ndarray, strength: float = 3.0) -> np.ndarray:
    """Two pushes a second, of that strength, on top of gravity."""
    push = np.sin(2 * np.pi * 2 * T_S)[:, None] * np.array([0.3, 0.5, 0.8])
    return gravity + strength * push


@pytest.mark.parametrize("language", LANGUAGES)
def test_gravity_is_told_by_the_data_in_any_language(tmp_path: Path, language: str) -> None:
    time, with_it, whole, linear = LANGUAGES[language]
    between = " " if whole.isascii() or language == "French" else ""
    meant = stepping(9.81 * UP)
    content = silent_files()
    del content["Accelerometer.csv"]
    both = ((f"A {linear}", linear, stepping(np.zeros(3))), (with_it, whole, meant))
    for file, quantity, values in both:
        columns = [(f"{quantity}{between}{x} (m/s²)", values[:, k]) for k, x in enumerate("xyz")]
        content[f"{file}.csv"] = table([(time, T_S), *columns])
    imu = read_phyphox(export(tmp_path, content)).recording.imu
    np.testing.assert_allclose(imu.accel_mps2, meant, atol=1e-6)
    del content[f"{with_it}.csv"]
    with pytest.raises(InputError, match="gravity is missing"):
        read_phyphox(export(tmp_path, content))


def test_several_sensors_in_one_table_are_told_apart(tmp_path: Path) -> None:
    content = silent_files()
    linear = sensor("Linear acceleration", "m/s^2", stepping(np.zeros(3)))
    whole = sensor("Acceleration", "m/s^2", stepping(9.81 * UP))
    content["Accelerometer.csv"] = table([*linear, *whole[1:]])
    imu = read_phyphox(export(tmp_path, content)).recording.imu
    np.testing.assert_allclose(imu.accel_mps2, stepping(9.81 * UP), atol=1e-6)


@pytest.mark.parametrize("names", [("Time (s)", "Pressure (hPa)"), ("Zeit (s)", "Druck (hPa)")])
def test_the_barometer_is_read_in_any_language(tmp_path: Path, names: tuple[str, str]) -> None:
    slow_s = np.arange(3.0)
    written = table([(names[0], slow_s), (names[1], [0.0, 1013.25, 1013.5])])
    made = export(tmp_path, {**silent_files(), "Pressure.csv": written})
    barometer = read_phyphox(made).recording.barometer
    np.testing.assert_allclose(barometer.t_s, [1, 2])
    np.testing.assert_allclose(barometer.pressure_hpa, [1013.25, 1013.5])
