"""The one rule by which senses are added up, and what a position and echoes say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F32, I64
from elfslam.serve.buildings.find import Evidence, FindParameters, Found, KnownFloor, decide
from elfslam.serve.buildings.senses import (
    EchoEvidence,
    EchoFindParameters,
    EchoIndex,
    Place,
    PositionFindParameters,
    Site,
    box_deg,
    distance_m,
    echo_evidence,
    position_log_odds,
    unit_rows,
)
from elfslam.serve.nearest import exact_search

PARAMETERS = FindParameters()
MALL = Site(47.0, 8.0, 80.0, 400.0)


def floor(number: int, site: Site = MALL, *, has_wifi: bool = True) -> KnownFloor:
    return KnownFloor(number, "Mall", number, f"map{number}", 1, site, has_wifi)


TWO = [floor(1), floor(2)]


def test_wifi_that_tells_the_floor_is_the_answer() -> None:
    answer = decide(TWO, Evidence(wifi={1: -4.0, 2: 9.0}), PARAMETERS)
    assert answer.status is Found.OK
    assert answer.candidates[0].floor.map_id == "map2"
    assert answer.candidates[0].share > 0.99


def test_floors_that_are_as_likely_are_ambiguous() -> None:
    answer = decide(TWO, Evidence(wifi={1: 9.0, 2: 9.0}), PARAMETERS)
    assert answer.status is Found.AMBIGUOUS
    assert [round(each.share, 3) for each in answer.candidates] == [0.5, 0.5]


def test_what_nothing_speaks_for_is_unknown() -> None:
    assert decide([], Evidence(wifi={}), PARAMETERS).status is Found.UNKNOWN_PLACE
    assert decide(TWO, Evidence(wifi={1: -3.0}, wifi_silent=-9.0), PARAMETERS).status is (
        Found.UNKNOWN_PLACE
    )
    assert decide(TWO, Evidence(), PARAMETERS).status is Found.AMBIGUOUS


def test_senses_add_up_and_each_is_bounded() -> None:
    """Position knows the building, Wi-Fi the floor; far away neither is believed alone."""
    here = Place(47.0, 8.0, 20.0)
    both = decide(TWO, Evidence(wifi={1: 0.0, 2: 3.0}, place=here), PARAMETERS)
    assert (both.status, both.candidates[0].floor.number) == (Found.OK, 2)
    wifi = decide(TWO, Evidence(wifi={1: 0.0, 2: 3.0}), PARAMETERS)
    assert wifi.status is Found.AMBIGUOUS
    away = replace(here, latitude_deg=48.0)
    against = decide(TWO, Evidence(wifi={1: 0.0, 2: 1e9}, place=away), PARAMETERS)
    assert against.status is not Found.OK


def test_a_sense_that_cannot_know_of_a_floor_says_nothing() -> None:
    bare = floor(3, has_wifi=False)
    evidence = Evidence(wifi={}, wifi_silent=-20.0, place=Place(47.0, 8.0, 10.0))
    answer = decide([floor(1), bare], evidence, PARAMETERS)
    assert [each.floor.number for each in answer.candidates] == [3]
    said = EchoEvidence({"map1": -8.0}, -6.0, frozenset(["map1"]))
    echo = decide(TWO, Evidence(wifi={1: 5.0, 2: 5.0}, echo=said), PARAMETERS)
    assert echo.candidates[0].floor.number == 2


def test_nothing_is_sure_where_one_sense_knows_another_building() -> None:
    """Wi-Fi of the mall, at a position where a kiosk stands of which Wi-Fi knows nothing."""
    kiosk = replace(floor(3, replace(MALL, latitude_deg=47.01), has_wifi=False), building="Kiosk")
    evidence = Evidence(wifi={1: 20.0}, place=Place(47.01, 8.0, 15.0))
    answer = decide([floor(1), kiosk], evidence, PARAMETERS)
    assert (answer.status, answer.candidates[0].floor.number) == (Found.AMBIGUOUS, 3)
    near = replace(evidence, wifi={1: 2.0})
    assert decide([floor(1), kiosk], near, PARAMETERS).status is Found.OK


def test_a_position_tells_the_building_and_an_altitude_the_floor() -> None:
    upper = replace(MALL, altitude_m=404.0)
    one, two = floor(1), floor(2, upper)
    flat = decide([one, two], Evidence(place=Place(47.0, 8.0, 15.0)), PARAMETERS)
    assert flat.status is Found.AMBIGUOUS
    high = Place(47.0, 8.0, 15.0, 404.2, 1.0)
    told = decide([one, two], Evidence(place=high), PARAMETERS)
    assert (told.status, told.candidates[0].floor.number) == (Found.OK, 2)
    vague = decide([one], Evidence(place=Place(47.0, 8.0, 1000.0)), PARAMETERS)
    assert vague.status is not Found.OK
    far = decide([one], Evidence(place=Place(47.01, 8.0, 30.0)), PARAMETERS)
    assert far.status is Found.UNKNOWN_PLACE


@pytest.mark.parametrize("latitude_deg", [0.0, 47.0, -80.0])
def test_the_box_holds_what_is_within_reach(latitude_deg: float) -> None:
    parameters = PositionFindParameters()
    place = Place(latitude_deg, 8.0, 100.0)
    south, west, north, east = box_deg(place, parameters)
    generator = np.random.default_rng(0)
    reach_m = parameters.reach_sigmas * 100 + parameters.largest_m
    for bearing in generator.uniform(0, 2 * math.pi, 200):
        away_m = reach_m * generator.uniform(0.9, 1.0)
        lat = latitude_deg + away_m * math.cos(bearing) / 111_195
        lon = 8.0 + away_m * math.sin(bearing) / 111_195 / math.cos(math.radians(latitude_deg))
        assert south <= lat <= north
        assert west <= lon <= east
        assert distance_m(place, Site(lat, lon, 1.0)) == pytest.approx(away_m, rel=1e-6)


def test_distances_cross_the_date_line() -> None:
    place, site = Place(0.0, 179.9995, 10.0), Site(0.0, -179.9995, 50.0)
    assert distance_m(place, site) == pytest.approx(111.2, rel=0.01)
    assert position_log_odds(place, site, PositionFindParameters()) < 0


class Exact:
    """An index that compares with every spot."""

    def __init__(self, spots: F32) -> None:
        self._spots = spots

    def search(self, vectors: F32, k: int) -> tuple[I64, F32]:
        return exact_search((self._spots,), vectors, k)


def sounds(generator: np.random.Generator, count: int) -> F32:
    """Places that have much in common, as all rooms sound like rooms."""
    common = np.eye(1, 128, dtype=np.float32)
    own = 0.35 * generator.standard_normal((count, 128)).astype(np.float32) / np.sqrt(128)
    return unit_rows(common + own)


def planted() -> tuple[EchoIndex, F32]:
    """Three floors of 40 spots, and footsteps heard on the middle one."""
    generator = np.random.default_rng(3)
    spots = sounds(generator, 120)
    noise = 0.01 * generator.standard_normal((4, 128)).astype(np.float32)
    floors = ("map7", "map8", "map9")
    index = EchoIndex(Exact(spots), lambda ids: np.where(ids < 0, -1, ids // 40), floors, "e")
    return index, unit_rows(spots[60:64] + noise)


def test_echoes_tell_the_floor_whose_spots_are_nearest() -> None:
    index, steps = planted()
    told = echo_evidence(steps, index, EchoFindParameters())
    said = {name: told.of(name) for name in index.floors}
    assert said["map8"] is not None
    assert said["map8"] > 3
    assert max(odds for name, odds in said.items() if odds is not None and name != "map8") < -1
    assert told.of("another floor") is None
    answer = decide([floor(7), floor(8), floor(9)], Evidence(echo=told), PARAMETERS)
    assert (answer.status, answer.candidates[0].floor.number) == (Found.OK, 8)


def test_echoes_of_another_place_speak_for_no_floor() -> None:
    index, _ = planted()
    told = echo_evidence(sounds(np.random.default_rng(4), 4), index, EchoFindParameters())
    answer = decide([floor(7), floor(8), floor(9)], Evidence(echo=told), PARAMETERS)
    assert answer.status is Found.UNKNOWN_PLACE


def test_rows_of_length_one() -> None:
    rows = unit_rows(np.array([[3.0, 4.0], [0.0, 0.0]], dtype=np.float32))
    assert rows.tolist() == [[pytest.approx(0.6), pytest.approx(0.8)]]
