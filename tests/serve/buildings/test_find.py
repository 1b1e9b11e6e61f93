"""Which floor a phone is on: by what Wi-Fi, position and echoes say, and how these are added up."""

import math
from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F32, I64
from elfslam.base.errors import InputError
from elfslam.base.values import WifiScans
from elfslam.serve.buildings import senses
from elfslam.serve.buildings.find import Evidence, FindParameters, Found, KnownFloor, decide
from elfslam.serve.nearest import exact_search

PARAMETERS = FindParameters()
MALL = senses.Site(47.0, 8.0, 80.0, 400.0)


def floor(number: int, site: senses.Site = MALL, *, has_wifi: bool = True) -> KnownFloor:
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
    here = senses.Place(47.0, 8.0, 20.0)
    both = decide(TWO, Evidence(wifi={1: 0.0, 2: 3.0}, place=here), PARAMETERS)
    assert (both.status, both.candidates[0].floor.number) == (Found.OK, 2)
    wifi = decide(TWO, Evidence(wifi={1: 0.0, 2: 3.0}), PARAMETERS)
    assert wifi.status is Found.AMBIGUOUS
    away = replace(here, latitude_deg=48.0)
    against = decide(TWO, Evidence(wifi={1: 0.0, 2: 1e9}, place=away), PARAMETERS)
    assert against.status is not Found.OK


def test_a_sense_that_cannot_know_of_a_floor_says_nothing() -> None:
    bare = floor(3, has_wifi=False)
    evidence = Evidence(wifi={}, wifi_silent=-20.0, place=senses.Place(47.0, 8.0, 10.0))
    answer = decide([floor(1), bare], evidence, PARAMETERS)
    assert [each.floor.number for each in answer.candidates] == [3]
    said = senses.EchoEvidence({"map1": -8.0}, -6.0, frozenset(["map1"]))
    echo = decide(TWO, Evidence(wifi={1: 5.0, 2: 5.0}, echo=said), PARAMETERS)
    assert echo.candidates[0].floor.number == 2


def test_nothing_is_sure_where_one_sense_knows_another_building() -> None:
    """Wi-Fi of the mall, at a position where a kiosk stands of which Wi-Fi knows nothing."""
    kiosk = replace(floor(3, replace(MALL, latitude_deg=47.01), has_wifi=False), building="Kiosk")
    evidence = Evidence(wifi={1: 20.0}, place=senses.Place(47.01, 8.0, 15.0))
    answer = decide([floor(1), kiosk], evidence, PARAMETERS)
    assert (answer.status, answer.candidates[0].floor.number) == (Found.AMBIGUOUS, 3)
    near = replace(evidence, wifi={1: 2.0})
    assert decide([floor(1), kiosk], near, PARAMETERS).status is Found.OK


def test_a_position_tells_the_building_and_an_altitude_the_floor() -> None:
    upper = replace(MALL, altitude_m=404.0)
    one, two = floor(1), floor(2, upper)
    flat = decide([one, two], Evidence(place=senses.Place(47.0, 8.0, 15.0)), PARAMETERS)
    assert flat.status is Found.AMBIGUOUS
    high = senses.Place(47.0, 8.0, 15.0, 404.2, 1.0)
    told = decide([one, two], Evidence(place=high), PARAMETERS)
    assert (told.status, told.candidates[0].floor.number) == (Found.OK, 2)
    vague = decide([one], Evidence(place=senses.Place(47.0, 8.0, 1000.0)), PARAMETERS)
    assert vague.status is not Found.OK
    far = decide([one], Evidence(place=senses.Place(47.01, 8.0, 30.0)), PARAMETERS)
    assert far.status is Found.UNKNOWN_PLACE


@pytest.mark.parametrize("latitude_deg", [0.0, 47.0, -80.0])
def test_the_box_holds_what_is_within_reach(latitude_deg: float) -> None:
    parameters = senses.PositionFindParameters()
    place = senses.Place(latitude_deg, 8.0, 100.0)
    south, west, north, east = senses.box_deg(place, parameters)
    generator = np.random.default_rng(0)
    reach_m = parameters.reach_sigmas * 100 + parameters.largest_m
    for bearing in generator.uniform(0, 2 * math.pi, 200):
        away_m = reach_m * generator.uniform(0.9, 1.0)
        lat = latitude_deg + away_m * math.cos(bearing) / 111_195
        lon = 8.0 + away_m * math.sin(bearing) / 111_195 / math.cos(math.radians(latitude_deg))
        assert south <= lat <= north
        assert west <= lon <= east
        assert senses.distance_m(place, senses.Site(lat, lon, 1.0)) == pytest.approx(
            away_m, rel=1e-6
        )


def test_distances_cross_the_date_line() -> None:
    place, site = senses.Place(0.0, 179.9995, 10.0), senses.Site(0.0, -179.9995, 50.0)
    assert senses.distance_m(place, site) == pytest.approx(111.2, rel=0.01)
    assert senses.position_log_odds(place, site, senses.PositionFindParameters()) < 0


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
    return senses.unit_rows(common + own)


def planted() -> tuple[senses.EchoIndex, F32]:
    """Three floors of 40 spots, and footsteps heard on the middle one."""
    generator = np.random.default_rng(3)
    spots = sounds(generator, 120)
    noise = 0.01 * generator.standard_normal((4, 128)).astype(np.float32)
    floors = ("map7", "map8", "map9")
    index = senses.EchoIndex(
        Exact(spots), lambda ids: np.where(ids < 0, -1, ids // 40), floors, "e"
    )
    return index, senses.unit_rows(spots[60:64] + noise)


def test_echoes_tell_the_floor_whose_spots_are_nearest() -> None:
    index, steps = planted()
    told = senses.echo_evidence(steps, index, senses.EchoFindParameters())
    said = {name: told.of(name) for name in index.floors}
    assert said["map8"] is not None
    assert said["map8"] > 3
    assert max(odds for name, odds in said.items() if odds is not None and name != "map8") < -1
    assert told.of("another floor") is None
    answer = decide([floor(7), floor(8), floor(9)], Evidence(echo=told), PARAMETERS)
    assert (answer.status, answer.candidates[0].floor.number) == (Found.OK, 8)


def test_echoes_of_another_place_speak_for_no_floor() -> None:
    index, _ = planted()
    told = senses.echo_evidence(
        sounds(np.random.default_rng(4), 4), index, senses.EchoFindParameters()
    )
    answer = decide([floor(7), floor(8), floor(9)], Evidence(echo=told), PARAMETERS)
    assert answer.status is Found.UNKNOWN_PLACE


def test_rows_of_length_one() -> None:
    rows = senses.unit_rows(np.array([[3.0, 4.0], [0.0, 0.0]], dtype=np.float32))
    assert rows.tolist() == [[pytest.approx(0.6), pytest.approx(0.8)]]


WIFI = senses.WifiFindParameters()
RADIOS = [0x0433_8900_0000 + 0x100 * k for k in range(12)]
UP, DOWN = 1, 2
LEVELS = {UP: np.linspace(-50, -80, 12), DOWN: np.linspace(-80, -50, 12)}
"""Two floors that hear the same, each its own half louder."""


def known(heard: dict[int, float], floors: tuple[int, ...] = (UP, DOWN)) -> dict[int, float]:
    scan = senses.scan_of(heard, WIFI)
    rows = [
        (k, floor, LEVELS[floor][RADIOS.index(number)])
        for k, number in enumerate(scan.bssid.tolist())
        for floor in floors
        if number in RADIOS
    ]
    place = np.array([row[:2] for row in rows], dtype=int).reshape(-1, 2).T
    level = np.array([row[2] for row in rows])
    table = senses.KnownPoints(*place, level, np.full(len(rows), 6.0), np.full(len(rows), 0.5))
    return senses.wifi_log_odds(scan, table, WIFI)


@pytest.mark.parametrize("deaf_db", [0.0, 10.0, -6.0])
@pytest.mark.parametrize(("floor", "other"), [(UP, DOWN), (DOWN, UP)])
def test_levels_tell_floors_apart_however_well_a_phone_hears(
    floor: int, other: int, deaf_db: float
) -> None:
    odds = known(dict(zip(RADIOS, LEVELS[floor] - deaf_db, strict=True)))
    assert odds[floor] > 3
    assert odds[other] < 0


def test_a_floor_that_nobody_mapped_is_not_the_one_below() -> None:
    """The same access points, the ones near by at the level of those far away."""
    odds = known(dict(zip(RADIOS, LEVELS[UP], strict=True)), floors=(DOWN,))
    assert odds[DOWN] < 0


def test_access_points_that_are_gone_or_new_do_not_hide_a_floor() -> None:
    heard = dict(zip(RADIOS, LEVELS[UP], strict=True))
    for k in (1, 4, 7):
        del heard[RADIOS[k]]
        heard[0x0455_0000_0000 + 0x100 * k] = -60.0
    odds = known(heard)
    assert odds[UP] > 3
    assert odds[DOWN] < 0


def test_one_known_among_many_others_is_no_place() -> None:
    """An access point that moved house."""
    heard = {RADIOS[0]: -50.0} | {0x0455_0000_0000 + 0x100 * k: -60.0 for k in range(9)}
    assert max(known(heard).values()) < 0


def test_phones_that_share_their_network_say_nothing() -> None:
    heard = dict(zip(RADIOS, LEVELS[UP], strict=True))
    made_up = {0x0655_0000_0000 + 0x100 * k: -40.0 for k in range(9)}
    assert known(heard | made_up) == known(heard)


def test_a_radio_counts_once_by_its_loudest_address() -> None:
    loud, base = 0x0233_8900_0003, 0x0033_8900_0001
    scan = senses.scan_of({base: -70.0, loud: -60.0, 0x0033_8900_0101: -65.0, 1 << 40: -30.0}, WIFI)
    assert scan.bssid.tolist() == [loud, 0x0033_8900_0101]
    assert scan.rssi_dbm.tolist() == [-60.0, -65.0]
    many = senses.scan_of({0x100 * k: -40.0 - k for k in range(200)}, WIFI)
    assert many.bssid.tolist() == [0x100 * k for k in range(WIFI.most_radios)]


def test_nothing_known_is_no_evidence() -> None:
    assert known({0x0455_0000_0000: -60.0}) == {}


def test_what_is_kept_of_walks() -> None:
    names = ("00:00:00:00:01:00", "02:00:00:00:02:00", "02:00:00:00:03:00", "00:00:00:00:04:00")
    first = np.full((6, 4), np.nan)
    first[:, 0], first[:4, 1], first[:5, 2], first[0, 3] = (
        [-60, -62, -64, -66, -68, -70],
        -70,
        -50,
        -40,
    )
    second = np.full((6, 4), np.nan)
    second[:4, 1] = -72
    t_s = np.arange(6) * 2.0
    walks = [WifiScans(t_s, names, each, np.where(np.isfinite(each), 0.5, np.nan))
             for each in (first, second)]  # fmt: skip
    points = senses.points_on(walks, WIFI)
    kept = [senses.bssid_text(number) for number in points.bssid.tolist()]
    assert kept == [names[0], names[1]]  # a hotspot on one walk, and one seen once, are left out
    assert points.level_dbm.tolist() == [-65.0, -71.0]
    assert points.share.tolist() == [0.5, 8 / 12]
    assert points.spread_db.tolist() == [5.0, 5.0]
    assert len(senses.points_on(walks[:1], WIFI).bssid) == 3


def test_addresses() -> None:
    assert senses.bssid_text(senses.bssid_number("04:33:89:79:FC:7c")) == "04:33:89:79:fc:7c"
    assert senses.bssid_number("00-00-00-00-01-02") == 0x102
    for wrong in ("", "04:33:89:79:fc", "home wifi", "04:33:89:79:fc:7g"):
        with pytest.raises(InputError, match="wanted six bytes"):
            senses.bssid_number(wrong)
