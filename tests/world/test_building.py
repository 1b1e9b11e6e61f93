"""Buildings: one motion over several floors, pressure, sound by room, and levels in the truth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.values import Barometer, Imu, LevelPassage, Levels, Truth
from elfslam.world.barometer import (
    DOOR_HPA,
    GAS_CONSTANT_JPKGK,
    INDOORS_K,
    pressure_at,
)
from elfslam.world.building import MultiFloorWorld, load_place, parse_building
from elfslam.world.imu import GRAVITY_MPS2
from elfslam.world.simulate_building import simulate_building

STOREY_M = 3.5
GENTLE = 0.35
"""Of pressure that doors, wind, weather and noise take part in (hPa)."""
HOUSE = """
name = "house"
plan = [0, 1, 2, 0]
entrances_m = [[4.0, 0.0]]

[[floor]]
level = 0
height_m = 0.0
world = "room.toml"

[[floor]]
level = 1
height_m = 3.5
world = "room.toml"
state = "moved"
seed = 8

[[floor]]
level = 2
height_m = 7.0
world = "room.toml"
seed = 9

[[passage]]
name = "stairs"
kind = "stairs"
levels = [0, 1, 2]
at_m = [0.0, 3.0]
heading_deg = 180.0
"""
ESCALATOR = """
[[passage]]
name = "escalator"
kind = "escalator"
levels = [0, 1]
at_m = [4.0, 3.0]
to_m = [11.5, 3.0]
"""
LIFT = """
[[passage]]
name = "lift"
kind = "lift"
levels = [0, 1, 2]
at_m = [16.0, 3.0]
heading_deg = 0.0
speed_mps = 1.0
"""
ROOM = """
name = "room"
size_m = [16.0, 6.0, 3.0]
reflection = [0.8, 0.8, 0.8, 0.8, 0.5, 0.7]
seed = 7
route_m = [[1.5, 1.0], [14.5, 1.0], [14.5, 5.0], [1.5, 5.0]]

[[furniture]]
name = "table"
corner_m = [7.0, 2.2, 0.0]
size_m = [2.0, 1.4, 0.8]

[[state]]
name = "moved"
moved = [{ name = "table", by_m = [1.0, 0.2] }]
"""


def house(text: str, folder: Path) -> MultiFloorWorld:
    (folder / "room.toml").write_text(ROOM, encoding="utf-8")
    return parse_building(text, "house.toml", folder)


@cache
def mall() -> MultiFloorWorld:
    place = load_place("mall_floors")
    assert isinstance(place, MultiFloorWorld)
    return place


def walked(
    building: MultiFloorWorld, seed: int, plan: tuple[int, ...] = ()
) -> tuple[Barometer, Imu, Levels, Truth]:
    recording, truth = simulate_building(building, seed, plan=plan, rounds=1, sound=False)
    assert recording.barometer
    assert recording.imu
    assert truth.levels
    return recording.barometer, recording.imu, truth.levels, truth


# --- laws ---


def test_the_barometric_formula() -> None:
    """An isothermal atmosphere falls to 1/e in one scale height, and by 0.116 hPa a metre here."""
    scale_m = GAS_CONSTANT_JPKGK * INDOORS_K / GRAVITY_MPS2
    assert pressure_at(1000.0, np.array([0.0, scale_m])) == pytest.approx([1000, 1000 / np.e])
    assert np.diff(pressure_at(1000.0, np.array([0.0, 1.0]))) == pytest.approx(-0.116, abs=0.001)
    assert DOOR_HPA[1] < 1.0


@pytest.mark.parametrize(
    ("passage", "kind"), [("", "stairs"), (ESCALATOR, "escalator"), (LIFT, "lift")]
)
def test_height_gained_is_that_of_the_floors(tmp_path: Path, passage: str, kind: str) -> None:
    building = house(HOUSE + passage, tmp_path)
    only = [each for each in building.links if each.kind == kind]
    seed, plan = 100, ((0, 1, 0) if kind == "escalator" else (0, 2, 1))
    barometer, imu, levels, _ = walked(replace(building, links=tuple(only)), seed, plan)
    assert levels.level[::2].tolist() == list(plan)
    assert np.isnan(levels.level[1::2]).all()
    assert set(levels.passages[1::2]) == {LevelPassage(kind)}
    on = levels.at(barometer.t_s)
    for level in set(plan[:2]):
        fell = (
            barometer.pressure_hpa[on == plan[0]].mean()
            - barometer.pressure_hpa[on == level].mean()
        )
        expected = 1010.0 - pressure_at(1010.0, np.array([STOREY_M * level]))[0]
        assert fell == pytest.approx(expected, abs=GENTLE)
    assert np.isfinite(imu.accel_mps2).all()


def test_position_is_continuous_and_nobody_runs() -> None:
    for seed in (100, 101):
        *_, truth = walked(mall(), seed)
        step_m = np.linalg.norm(np.diff(truth.world_from_body[:, :2], axis=0), axis=1)
        assert step_m.max() * 50 < 2.2
        assert np.abs(np.diff(truth.world_from_body[:, 2])).max() * 50 < 4.5


def test_the_same_seed_gives_the_same_walk() -> None:
    first, again, other = (walked(mall(), seed)[0] for seed in (100, 100, 101))
    assert first.pressure_hpa.tobytes() == again.pressure_hpa.tobytes()
    assert len(first.t_s) != len(other.t_s)
