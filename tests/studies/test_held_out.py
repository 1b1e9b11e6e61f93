"""Held-out walks in a planted floor: found from anywhere, live only by what was known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Imu, Magnetometer, Odometry, Recording, Truth, WifiScans
from studies.held_out import (
    at_each_place,
    drawn,
    floor_places,
    live,
    pulled_rows,
    whole_walk,
    whole_walk_by_field,
)
from studies.labelled_neighbours import labelled_neighbours
from studies.mall_fifths import METHODS, SPLITS, fifths_row, positions, split_walks
from studies.mall_floor import FloorWalk, floor_turn, turned

STEP_M = 0.7
SIGHTS_M = np.array([[x, y] for x in (0.0, 12.0, 24.0, 36.0) for y in (-6.0, 6.0)])


def walk_along(y_m, *, backwards=False, shift_m=(0.0, 0.0)):
    """A corridor of 36 m, access points on both sides; dead reckoning begins elsewhere."""
    t_s = 0.5 * np.arange(52)
    x_m = STEP_M * np.arange(52)
    x_m = x_m[::-1] if backwards else x_m
    true = np.column_stack([x_m, np.full(52, y_m), np.full(52, np.pi if backwards else 0.0)])
    apart_m = np.linalg.norm(true[:, None, :2] - SIGHTS_M[None], axis=2)
    rssi = -40.0 - 28.0 * np.log10(np.maximum(apart_m, 1.0))
    wifi = WifiScans(t_s[::4], tuple("abcdefgh"), rssi[::4], np.zeros(rssi[::4].shape))
    field = np.column_stack([20 + 5 * np.sin(x_m), np.zeros(52), np.full(52, -40.0)])
    nodes = Odometry(t_s, true + np.array([*shift_m, 0.0]), np.full((51, 3), 0.05))
    still = np.tile([0.0, 0.0, 9.81], (52, 1))
    recording = Recording(
        "walk",
        "phone",
        imu=Imu(t_s, still, 0 * still),
        magnetometer=Magnetometer(t_s, field),
        wifi=wifi,
    )
    return FloorWalk(recording, Truth(t_s[::8], true[::8]), nodes)


@pytest.fixture(scope="module")
def places():
    walks = [walk_along(y_m, backwards=y_m > 0) for y_m in (-2.0, -1.0, 1.0, 2.0)]
    return floor_places(walks, [walk.nodes.world_from_body for walk in walks])


def errors(walk, at):
    return np.linalg.norm(at - walk.truth.world_from_body[:, :2], axis=1)


@pytest.mark.parametrize("solve", [whole_walk, whole_walk_by_field])
def test_a_walk_from_anywhere_is_found_as_a_whole(places, solve):
    walk = walk_along(0.0, shift_m=(400.0, -90.0))
    at = solve(walk, places)[::8, :2]
    assert np.median(errors(walk, at)) < 1.5


def test_where_dead_reckoning_begins_makes_no_difference(places):
    near, far = (whole_walk(walk_along(0.5, shift_m=shift), places) for shift in ((0, 0), (700, 0)))
    assert near == pytest.approx(far, abs=1e-3)


def test_a_place_alone_is_found_without_dead_reckoning(places):
    walk = walk_along(0.0)
    still = replace(walk, nodes=replace(walk.nodes, world_from_body=np.zeros((52, 3))))
    assert np.median(errors(walk, at_each_place(still, places, walk.truth.t_s))) < 2.5


def test_live_knows_nothing_of_what_comes(places):
    walk = walk_along(0.0, shift_m=(50.0, 50.0))
    wifi = walk.recording.wifi
    changed = np.where(wifi.t_s[:, None] > 12.0, -50.0, wifi.rssi_dbm)
    lied = replace(walk, recording=replace(walk.recording, wifi=replace(wifi, rssi_dbm=changed)))
    at_s = np.array([0.0, 8.0, 12.0, 24.0])
    one, other = live(walk, places, at_s), live(lied, places, at_s)
    assert np.isnan(one[0]).all()
    assert one[1:3] == pytest.approx(other[1:3])
    assert np.linalg.norm(one[3] - other[3]) > 1.0
    assert np.linalg.norm(one[2] - [24 * STEP_M, 0.0]) < 3.0


def test_nothing_heard_in_common_gives_no_position():
    nodes = walk_along(0.0).nodes
    nothing = np.full((len(pulled_rows(nodes)), 2), np.nan)
    assert np.isnan(drawn(nodes, nothing)).all()


def test_a_walk_without_scans_cannot_be_located(places):
    walk = walk_along(0.0)
    mute = replace(walk, recording=replace(walk.recording, wifi=None))
    with pytest.raises(InputError, match="no Wi-Fi"):
        whole_walk(mute, places)


@pytest.mark.parametrize("distance", ["Soerensen", "Euclidean"])
def test_labelled_scans_find_the_walk_that_is_the_same(distance):
    scans = [(w.recording.wifi, w.truth) for w in map(walk_along, (-4.0, 0.0, 4.0))]
    (at,) = labelled_neighbours(scans[1:2], scans, distance)
    true = scans[1][1].world_from_body[:, :2]
    assert np.median(np.linalg.norm(at - true, axis=1)) < 2.0


def test_a_floor_is_turned_back_about_the_starts():
    walks = [turned(walk_along(y_m), 0.5) for y_m in (-1.0, 1.0)]
    assert floor_turn(walks) == pytest.approx(-0.5)
    back = turned(walks[0], floor_turn(walks)).nodes.world_from_body
    assert back == pytest.approx(walk_along(-1.0).nodes.world_from_body)


def test_every_walk_is_held_out_once():
    walks = [walk_along(y_m) for y_m in np.linspace(-3, 3, 11)]
    held = [number for which in range(SPLITS) for number in split_walks(walks, which)[1]]
    assert sorted(held) == list(range(11))
    assert all(len(split_walks(walks, which)[0]) == count for which, count in ((0, 8), (1, 9)))


def test_every_method_answers_and_a_row_counts_it(places):
    walk = walk_along(0.0, shift_m=(9.0, 9.0))
    found = positions([walk_along(-1.0), walk_along(1.0)], places, [walk])
    assert tuple(found) == METHODS
    row = fifths_row("F1", "Wi-Fi, live", [walk], found["Wi-Fi, live"])
    assert row["waypoints"] == 7
    assert 50 < row["answered (%)"] < 100
    assert fifths_row("F1", "same", [walk], [walk.truth.world_from_body[:, :2]])[
        "median (m)"
    ].startswith("0.0 [")
