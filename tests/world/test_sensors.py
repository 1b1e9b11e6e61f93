"""Sensors beside sound and motion: their tables, their independence, their way to disk and back."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planted_blocks import loaded

from elfslam.base.errors import InputError
from elfslam.base.values import Recording, Truth
from elfslam.world.device import BMI160, BROWSER
from elfslam.world.sensors import Sensor, parse_sensors
from elfslam.world.simulate import simulate
from elfslam.world.wifi import MALL_SCANS
from elfslam.world.world_file import World, load_world, world_names

CLOSET = """
name = "closet"
size_m = [4.0, 3.0, 2.5]
reflection = [0.8, 0.8, 0.8, 0.8, 0.5, 0.7]
furniture_seed = 3
route_m = [[0.8, 0.8], [3.2, 0.8], [3.2, 2.2], [0.8, 2.2]]
"""
TABLES = """
[[access_point]]
bssid = "router"
position_m = [3.5, 2.5, 2.0]
power_dbm = 15.0
channel = 6

[[access_point]]
bssid = "neighbour"
position_m = [-4.0, 1.0, 2.0]

[magnetic]
strength_ut = 48.0
north_deg = 30.0

[[power_line]]
name = "sockets"
from_m = [0.0, 0.0, 0.3]
to_m = [4.0, 0.0, 0.3]
current_a = [1.0, 0.1, 0.4]
"""
SENSED = ("wifi", "magnetometer", "emr", "barometer")


def world_of(folder: Path, text: str) -> World:
    path = folder / "closet.toml"
    path.write_text(text, encoding="utf-8")
    return load_world(str(path))


@pytest.fixture(scope="module")
def studio() -> World:
    return load_world("studio")


@pytest.fixture(scope="module")
def plain(studio: World) -> tuple[Recording, Truth]:
    return simulate(studio, 3, rounds=1)


@pytest.fixture(scope="module")
def sensed(studio: World) -> Recording:
    return simulate(studio, 3, rounds=1, sound=False, sensors=list(Sensor))[0]


def bytes_of(value: object) -> bytes:
    arrays = [getattr(value, item.name) for item in fields(value)]
    return b"".join(values.tobytes() for values in arrays if isinstance(values, np.ndarray))


def test_a_walk_without_them_is_what_it_always_was(plain: tuple[Recording, Truth]) -> None:
    """Readings of this walk before these sensors existed; any other draw would change them."""
    recording, truth = plain
    assert [getattr(recording, name) for name in SENSED] == [None] * 4
    sound = recording.audio.samples[0, [5_000, 100_000, 300_000]]
    np.testing.assert_allclose(sound, [1.700160e-4, 2.359560e-4, -1.716932e-4], atol=1e-8)
    accel, gyro = recording.imu.accel_mps2[700], recording.imu.gyro_radps[700]
    np.testing.assert_allclose(accel, [-1.1879293, 3.5676326, 9.5712644], atol=1e-6)
    np.testing.assert_allclose(gyro, [-0.1318850, 0.3966502, 0.8894377], atol=1e-6)
    np.testing.assert_allclose(truth.world_from_body[600], [5.1999916, 5.4568185, 3.0918498])
    assert recording.audio.samples.shape == (1, 910_003)


@pytest.mark.parametrize("more", [{"sensors": tuple(Sensor)}, {"sound": False}], ids=str)
def test_motion_and_sound_stay_as_they_are(
    studio: World, plain: tuple[Recording, Truth], more: dict[str, Any]
) -> None:
    """With other sensors, and the motion without any sound."""
    recording, truth = simulate(studio, 3, rounds=1, **more)
    if more.get("sound", True):
        assert recording.audio.samples.tobytes() == plain[0].audio.samples.tobytes()
    else:
        assert recording.audio is None
    assert recording.imu.accel_mps2.tobytes() == plain[0].imu.accel_mps2.tobytes()
    assert recording.imu.gyro_radps.tobytes() == plain[0].imu.gyro_radps.tobytes()
    assert truth.world_from_body.tobytes() == plain[1].world_from_body.tobytes()


@pytest.mark.parametrize(("sensor", "name"), list(zip(Sensor, SENSED, strict=True)))
def test_each_reads_the_same_without_the_others(
    studio: World, sensed: Recording, sensor: Sensor, name: str
) -> None:
    alone = simulate(studio, 3, rounds=1, sound=False, sensors=[sensor])[0]
    assert bytes_of(getattr(alone, name)) == bytes_of(getattr(sensed, name))
    others = set(SENSED) - {name}
    assert all(getattr(alone, other) is None for other in others)
    another_day = simulate(studio, 4, rounds=1, sound=False, sensors=[sensor])[0]
    assert bytes_of(getattr(another_day, name)) != bytes_of(getattr(sensed, name))


def test_another_grade_and_another_way_to_scan(studio: World) -> None:
    scanned = {"sensors": [Sensor.WIFI], "wifi": MALL_SCANS}
    recording, truth = simulate(studio, 3, rounds=1, sound=False, grade=BROWSER, **scanned)
    assert recording.device == f"simulated phone, {BROWSER.name}"
    assert 1 / np.diff(recording.imu.t_s).mean() == pytest.approx(60.0)
    assert np.diff(recording.wifi.t_s).mean() == pytest.approx(2.2, abs=0.1)
    assert BMI160.name in simulate(studio, 3, rounds=1, sound=False)[0].device
    assert truth.t_s[-1] > 10


@pytest.mark.parametrize("name", world_names())
def test_built_in_worlds_have_something_for_every_sensor(name: str) -> None:
    world = loaded(name)
    recording = simulate(world, 0, rounds=1, sound=False, sensors=list(Sensor))[0]
    assert len(recording.wifi.bssids) == len(world.surroundings.access_points) >= 5
    magnitude_ut = np.linalg.norm(recording.magnetometer.field_ut, axis=1)
    assert 30 < magnitude_ut.mean() < 75
    assert 1 < magnitude_ut.std() < 15
    assert np.ptp(recording.emr.amplitude[:, 0]) > 0.1


def test_the_walls_of_the_room_count(tmp_path: Path) -> None:
    """The neighbour is heard through one wall."""
    world = world_of(tmp_path, CLOSET + TABLES)
    heard = []
    for walls_m in (world.surroundings.walls_m, np.zeros((0, 2, 2))):
        around = replace(world.surroundings, walls_m=walls_m)
        changed = replace(world, surroundings=around)
        recording = simulate(changed, 0, rounds=2, sound=False, sensors=[Sensor.WIFI])[0]
        heard.append(np.nanmean(recording.wifi.rssi_dbm, axis=0))
    neighbour, router = heard[1] - heard[0]
    assert neighbour == pytest.approx(6.0, abs=1.0)
    assert router == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize(
    ("sensor", "table"),
    [
        (Sensor.WIFI, r"\[\[access_point\]\]"),
        (Sensor.MAGNETIC, r"\[magnetic\]"),
        (Sensor.EMR, r"\[\[power_line\]\]"),
    ],
)
def test_a_world_without_table_refuses_sensors(tmp_path: Path, sensor: Sensor, table: str) -> None:
    with pytest.raises(InputError, match=f"sensor {sensor}: the world has no {table}; add one"):
        simulate(world_of(tmp_path, CLOSET), 0, rounds=1, sound=False, sensors=[sensor])


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("[3.5, 2.5, 2.0]", "[3.5, 2.5]", r"access_point 'router': .*position_m: wanted shape"),
        ("channel = 6", "channel = 20", "access_point 'router': channel 20: wanted 1 to 14"),
        ("power_dbm = 15.0", 'power_dbm = "loud"', "access_point 'router': power_dbm is 'loud'"),
        ("position_m = [-4.0, 1.0, 2.0]", "", "access_point 'neighbour': .*position_m"),
        ('"neighbour"', '"router"', "access_point 'router': appears twice"),
        ('bssid = "neighbour"', "", "access_point 2: .*bssid"),
        ("strength_ut = 48.0", "strength_ut = -1.0", "magnetic: strength_ut is -1.0"),
        ("to_m = [4.0, 0.0, 0.3]", "to_m = [0.0, 0.0, 0.3]", "power_line 'sockets': begins where"),
        ("[1.0, 0.1, 0.4]", "[1.0, -0.1]", "power_line 'sockets': current_a has to be amplitudes"),
        ("[1.0, 0.1, 0.4]", "[1.0, 1e7]", "power_line 'sockets': current_a is 10000000"),
        ("[1.0, 0.1, 0.4]", f"{[1.0] * 101}", "current_a has to be .* one to 100 of them"),
        ("to_m = [4.0, 0.0, 0.3]", "to_m = [1e14, 0.0, 0.3]", "power_line 'sockets': lies beyond"),
        ("position_m = [-4.0, 1.0, 2.0]", "position_m = [-4e9, 1.0, 2.0]", "lies beyond 500 m"),
        ("power_dbm = 15.0", "power_dbm = 1e308", "power_dbm is 1e.308, wanted a number from"),
        ("strength_ut = 48.0", "dipoles_per_m2 = 10000.0", "dipoles behind the surfaces"),
        ("[magnetic]", "[[magnetic]]", "magnetic: wanted a .magnetic. table"),
    ],
)
def test_broken_tables_are_refused(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    assert old in TABLES
    with pytest.raises(InputError, match=complaint) as refusal:
        world_of(tmp_path, CLOSET + TABLES.replace(old, new, 1))
    assert "\n" not in str(refusal.value)


def test_sensors_by_name() -> None:
    assert parse_sensors("wifi, emr") == {Sensor.WIFI, Sensor.EMR}
    assert parse_sensors("") == set()
    with pytest.raises(InputError, match="sensor 'radar': wanted wifi, magnetic, emr"):
        parse_sensors("wifi,radar")
