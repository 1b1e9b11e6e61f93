"""Held-out walks in a planted floor: found from anywhere, live only by what was known."""

from dataclasses import replace

import numpy as np
import pytest
from planted_floor import STEP_M, STEPS, walk_along

from elfslam.base.enums import Modality, Mode
from elfslam.base.errors import InputError
from elfslam.base.values import NO_CLOSURES, FixStatus
from elfslam.baselines import floor_places as on_floor
from elfslam.baselines.floor_places import floor_places, known_by, locate_on_floor, whole_walk
from elfslam.baselines.floor_walks import FloorParameters, corrected, floor_map

BOTH = (Modality.WIFI, Modality.MAGNETIC)
PARAMETERS = FloorParameters()


@pytest.fixture(scope="module")
def mapped():
    walks = [walk_along(y_m, backwards=y_m > 0) for y_m in (-2.0, -1.0, 1.0, 2.0)]
    as_walked = corrected([walk.nodes for walk in walks], NO_CLOSURES)
    return floor_map(walks, as_walked, BOTH, PARAMETERS)


@pytest.fixture(scope="module")
def places(mapped):
    return floor_places(mapped, [Modality.WIFI], PARAMETERS)


def errors(walk, xy_m):
    return np.linalg.norm(xy_m - walk.truth.world_from_body[:, :2], axis=1)


@pytest.mark.parametrize("by", [BOTH[:1], BOTH], ids=["wifi", "both"])
def test_a_walk_from_anywhere_is_found_as_a_whole(mapped, by):
    walk = walk_along(0.0, shift_m=(400.0, -90.0))
    found = whole_walk(walk, floor_places(mapped, by, PARAMETERS))
    assert np.median(errors(walk, found.world_from_body[::8, :2])) < 1.5


def test_the_field_tells_which_of_the_places_near_by_are_meant(mapped):
    walk = walk_along(0.0)
    both = floor_places(mapped, BOTH, PARAMETERS)
    blurred = replace(walk, recording=replace(walk.recording, wifi=blurred_wifi(walk)))
    by_field = whole_walk(blurred, both).world_from_body[::8, :2]
    by_wifi = whole_walk(blurred, replace(both, levels=None)).world_from_body[::8, :2]
    assert errors(walk, by_field).mean() < errors(walk, by_wifi).mean() - 0.3


def blurred_wifi(walk):
    """All scans as if made 4 m behind."""
    wifi = walk.recording.wifi
    return replace(wifi, t_s=wifi.t_s + 4.0 / STEP_M * 0.5)


def test_where_dead_reckoning_begins_makes_no_difference(places):
    near, far = (whole_walk(walk_along(0.5, shift_m=at), places) for at in ((0, 0), (700, 0)))
    assert near.world_from_body == pytest.approx(far.world_from_body, abs=1e-3)


def test_a_place_alone_is_found_without_dead_reckoning(places):
    walk = walk_along(0.0)
    nodes = replace(walk.nodes, world_from_body=np.zeros((STEPS, 3)))
    fixes = on_floor.at_each_place(replace(walk, nodes=nodes), places)
    true_m = STEP_M * (np.arange(STEPS - 1) + 0.5)
    assert np.median(np.abs(fixes.xy_m[:, 0] - true_m)) < 2.5
    assert np.isfinite(fixes.covariance_m2).all()


def test_live_knows_nothing_of_what_comes(places):
    walk = walk_along(0.0, shift_m=(50.0, 50.0))
    wifi = walk.recording.wifi
    changed = np.where(wifi.t_s[:, None] > 12.0, -50.0, wifi.rssi_dbm)
    lied = replace(walk, recording=replace(walk.recording, wifi=replace(wifi, rssi_dbm=changed)))
    one, other = ([known_by(at, places, n) for n in (1, 17, 25, 49)] for at in (walk, lied))
    assert one[0] is None
    for k in (1, 2):
        assert one[k].world_from_body == pytest.approx(other[k].world_from_body)
    last, lie = (known[3].world_from_body[-1, :2] for known in (one, other))
    assert np.linalg.norm(last - lie) > 1.0
    assert np.linalg.norm(one[2].world_from_body[-1, :2] - [24 * STEP_M, 0.0]) < 3.0


def test_live_heads_by_the_compass_of_then_and_not_by_how_the_walk_ended(places):
    walk = walk_along(0.0)
    quarter = walk.nodes.world_from_body @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
    quarter[:, 2] += np.pi / 2
    turned = replace(walk, nodes=replace(walk.nodes, world_from_body=quarter))
    one, other = (known_by(each, places, 30).world_from_body for each in (walk, turned))
    assert one == pytest.approx(other, abs=1e-6)


@pytest.mark.parametrize("mode", list(Mode))
def test_every_mode_gives_fixes_with_a_sigma(places, mode):
    walk = walk_along(0.0, shift_m=(9.0, 9.0))
    fixes = locate_on_floor(walk, places, mode)
    known = fixes.status == FixStatus.OK
    assert len(fixes.t_s) == STEPS - (mode is Mode.ONE_SHOT)
    assert known.mean() > 0.9
    assert np.isfinite(fixes.xy_m[known]).all()
    assert (np.linalg.eigvalsh(fixes.covariance_m2[known]) > 0).all()


@pytest.mark.parametrize("mode", list(Mode))
def test_a_walk_that_hears_nothing_of_the_map_is_in_an_unknown_place(places, mode):
    walk = walk_along(0.0)
    others = replace(walk.recording.wifi, bssids=tuple("stuvwxyz"))
    strange = replace(walk, recording=replace(walk.recording, wifi=others))
    fixes = locate_on_floor(strange, places, mode)
    assert (fixes.status == FixStatus.UNKNOWN_PLACE).all()
    assert np.isnan(fixes.xy_m).all()


@pytest.mark.parametrize("mode", list(Mode))
def test_a_walk_without_scans_cannot_be_located(places, mode):
    walk = walk_along(0.0)
    mute = replace(walk, recording=replace(walk.recording, wifi=None))
    with pytest.raises(InputError, match="no Wi-Fi"):
        locate_on_floor(mute, places, mode)


def test_a_walk_without_a_field_cannot_be_located_by_it(mapped):
    walk = walk_along(0.0)
    mute = replace(walk, recording=replace(walk.recording, magnetometer=None))
    with pytest.raises(InputError, match="no magnetometer"):
        whole_walk(mute, floor_places(mapped, BOTH, PARAMETERS))


def test_a_map_is_asked_for_what_it_knows(mapped):
    with pytest.raises(InputError, match="the field alone tells no place"):
        floor_places(mapped, [Modality.MAGNETIC], PARAMETERS)
    with pytest.raises(InputError, match="wanted a payload magnetic"):
        floor_places(replace(mapped, payloads=mapped.payloads[:1]), BOTH, PARAMETERS)
    with pytest.raises(InputError, match="wanted a payload wifi"):
        floor_places(replace(mapped, payloads=mapped.payloads[1:]), BOTH, PARAMETERS)
