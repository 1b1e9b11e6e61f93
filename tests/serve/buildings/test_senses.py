"""Which floor hears what a phone hears: planted levels, deaf phones, strangers, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import WifiScans
from elfslam.serve.buildings.senses import (
    KnownPoints,
    WifiFindParameters,
    bssid_number,
    bssid_text,
    points_on,
    scan_of,
    wifi_log_odds,
)

PARAMETERS = WifiFindParameters()
RADIOS = [0x0433_8900_0000 + 0x100 * k for k in range(12)]
UP, DOWN = 1, 2
LEVELS = {UP: np.linspace(-50, -80, 12), DOWN: np.linspace(-80, -50, 12)}
"""Two floors that hear the same, each its own half louder."""


def known(heard: dict[int, float], floors: tuple[int, ...] = (UP, DOWN)) -> dict[int, float]:
    scan = scan_of(heard, PARAMETERS)
    rows = [
        (k, floor, LEVELS[floor][RADIOS.index(number)])
        for k, number in enumerate(scan.bssid.tolist())
        for floor in floors
        if number in RADIOS
    ]
    place = np.array([row[:2] for row in rows], dtype=int).reshape(-1, 2).T
    level = np.array([row[2] for row in rows])
    table = KnownPoints(*place, level, np.full(len(rows), 6.0), np.full(len(rows), 0.5))
    return wifi_log_odds(scan, table, PARAMETERS)


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
    scan = scan_of({base: -70.0, loud: -60.0, 0x0033_8900_0101: -65.0, 1 << 40: -30.0}, PARAMETERS)
    assert scan.bssid.tolist() == [loud, 0x0033_8900_0101]
    assert scan.rssi_dbm.tolist() == [-60.0, -65.0]
    many = scan_of({0x100 * k: -40.0 - k for k in range(200)}, PARAMETERS)
    assert many.bssid.tolist() == [0x100 * k for k in range(PARAMETERS.most_radios)]


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
    points = points_on(walks, PARAMETERS)
    kept = [bssid_text(number) for number in points.bssid.tolist()]
    assert kept == [names[0], names[1]]  # a hotspot on one walk, and one seen once, are left out
    assert points.level_dbm.tolist() == [-65.0, -71.0]
    assert points.share.tolist() == [0.5, 8 / 12]
    assert points.spread_db.tolist() == [5.0, 5.0]
    assert len(points_on(walks[:1], PARAMETERS).bssid) == 3


def test_addresses() -> None:
    assert bssid_text(bssid_number("04:33:89:79:FC:7c")) == "04:33:89:79:fc:7c"
    assert bssid_number("00-00-00-00-01-02") == 0x102
    for wrong in ("", "04:33:89:79:fc", "home wifi", "04:33:89:79:fc:7g"):
        with pytest.raises(InputError, match="wanted six bytes"):
            bssid_number(wrong)
