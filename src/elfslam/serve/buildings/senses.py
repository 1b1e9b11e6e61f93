"""What Wi-Fi, position and echoes each say of the floor that a phone is on.

Which access points are known tells the place; how loud they are tells its floors apart, as these
hear many of the same. Phones hear up to 10 dB differently: what all levels have in common is
taken off. A radio that speaks under several addresses counts once, by the loudest of them.
"""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elfslam.base.arrays import F32, F64, I64, Value, array
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.base.values import WifiScans
from elfslam.baselines.wifi import sightings
from elfslam.serve.nearest import VoteParameters, which_map

BSSID = re.compile(r"([0-9a-f]{2}[:-]){5}[0-9a-f]{2}")
GROUP_BIT, LOCAL_BIT = 1 << 40, 1 << 41
RADIO_MASK = 0x00FF_FFFF_FFF0
"""One radio has many addresses, which differ in the first octet and in the last four bits."""
ELSEWHERE_DBM, ELSEWHERE_DB = -75.0, 12.0
"""Levels of access points that are heard anywhere."""
USUAL_SHARE = 0.2
"""Of the scans on its floor, an access point is in about so many."""


@dataclass(frozen=True)
class WifiFindParameters:
    """How far access points tell the floor."""

    most_radios: int = parameter(40, "", "so many of the loudest are looked up", low=1, high=400)
    known_log_odds: float = parameter(
        2.5, "", "what a radio that is known on a floor speaks for the place", low=0.0, high=20.0
    )
    new_share: float = parameter(
        0.3, "", "of the radios on a floor that are not in its map", low=0.01, high=0.9
    )
    deafness_db: float = parameter(8.0, "dB", "phones hear so differently", low=0.1, high=40.0)
    least_spread_db: float = parameter(
        5.0, "dB", "a level varies at least so much over a floor", low=0.5, high=40.0
    )
    unmapped_db: float = parameter(
        12.0, "dB", "levels differ so on a floor beside that is not mapped", low=1.0, high=40.0
    )
    level_weight: float = parameter(
        0.8, "", "of levels, which err together where a phone stands", low=0.0, high=1.0
    )
    least_sightings: int = parameter(
        3, "", "rarer ones are passers-by and not kept", low=1, high=1000
    )


@dataclass(frozen=True, eq=False)
class FloorPoints(Value):
    """What is heard on a floor: access points (n), their mean level and how it varies.

    `share` (n): of all scans, in how many each is heard.
    """

    bssid: I64 = array("n", dtype=np.int64)
    level_dbm: F64 = array("n")
    spread_db: F64 = array("n")
    share: F64 = array("n")


@dataclass(frozen=True, eq=False)
class Scan(Value):
    """What a phone hears: a radio each, by its loudest address."""

    bssid: I64 = array("n", dtype=np.int64)
    rssi_dbm: F64 = array("n")


@dataclass(frozen=True, eq=False)
class KnownPoints(Value):
    """Who knows what of a scan: row k says that `floor` hears the `heard`-th of it so."""

    heard: I64 = array("k", dtype=np.int64)
    floor: I64 = array("k", dtype=np.int64)
    level_dbm: F64 = array("k")
    spread_db: F64 = array("k")
    share: F64 = array("k")


def bssid_number(text: str) -> int:
    """The 48 bits of an address such as 04:33:89:79:fc:7c. Raises InputError."""
    if not BSSID.fullmatch(text.lower()):
        raise InputError(f"bssid {text!r:.40}: wanted six bytes such as 04:33:89:79:fc:7c")
    return checked_bssid_number(text)


def checked_bssid_number(text: str) -> int:
    """The 48 bits of what is known to be an address."""
    return int(text.replace(":", "").replace("-", ""), 16)


def bssid_text(number: int) -> str:
    """The address of 48 bits."""
    return ":".join(f"{number >> shift & 0xFF:02x}" for shift in range(40, -1, -8))


def points_on(scans: Sequence[WifiScans], parameters: WifiFindParameters) -> FloorPoints:
    """What the walks of a floor heard.

    Left out is who was heard a few times only, and, of addresses that devices make up for
    themselves, who was heard on one walk of several: those are phones that share their network.
    """
    levels, walks = _levels_by_point(scans)
    count = sum(len(wifi.t_s) for wifi in scans)
    least = parameters.least_sightings
    kept = sorted(
        number for number, found in levels.items()
        if len(found) >= least and not _is_passing(number, walks[number], len(scans))
    )  # fmt: skip
    sighted = np.array([len(levels[number]) for number in kept], dtype=np.float64)
    spread = np.array([np.std(levels[number]) for number in kept], dtype=np.float64)
    return FloorPoints(
        bssid=np.array(kept, dtype=np.int64),
        level_dbm=np.array([np.mean(levels[number]) for number in kept], dtype=np.float64),
        spread_db=np.maximum(spread, parameters.least_spread_db),
        share=np.minimum(sighted / max(count, 1), 1.0),
    )


def scan_of(heard: Mapping[int, float], parameters: WifiFindParameters) -> Scan:
    """The loudest radios of what is heard (dBm by address)."""
    loudest = sorted((-dbm, number) for number, dbm in heard.items())
    radios: dict[int, int] = {}
    for _, number in loudest:
        if not number & GROUP_BIT:
            radios.setdefault(number & RADIO_MASK, number)
    kept = list(radios.values())[: parameters.most_radios]
    return Scan(np.array(kept, dtype=np.int64), np.array([heard[number] for number in kept]))


def wifi_log_odds(
    scan: Scan, known: KnownPoints, parameters: WifiFindParameters
) -> dict[int, float]:
    """What a scan says for each floor that knows of it, against being anywhere else.

    Anywhere else is also a floor beside it that nobody mapped: the same access points, at other
    levels. A made-up address that no floor knows says nothing: it is a phone nearby.
    """
    if not len(known.floor):
        return {}
    floors, group = np.unique(known.floor, return_inverse=True)
    strangers = (scan.bssid & LOCAL_BIT) != 0
    strangers[known.heard] = False
    radios = int((~strangers).sum())
    matched = np.bincount(group, minlength=len(floors))
    place = matched * parameters.known_log_odds
    place += (radios - matched) * np.log(parameters.new_share)
    here = _level_fit(scan, known, group, known.spread_db, parameters)
    beside_db = np.hypot(known.spread_db, parameters.unmapped_db)
    beside = _level_fit(scan, known, group, beside_db, parameters)
    best = max(here.max(), beside.max())
    total = place + parameters.level_weight * (here - best)
    elsewhere = np.logaddexp(0.0, (place + parameters.level_weight * (beside - best)).max())
    return dict(zip(floors.tolist(), (total - elsewhere).tolist(), strict=True))


def _level_fit(
    scan: Scan, known: KnownPoints, group: I64, spread_db: F64, parameters: WifiFindParameters
) -> F64:
    """How well each floor explains who is heard how loudly: log-likelihood (f), to compare.

    A point is heard as often as its share says, with a Gaussian level, or it is new; the phone's
    deafness, Gaussian too, is the likeliest.
    """
    apart = scan.rssi_dbm[known.heard] - known.level_dbm
    weight = spread_db**-2.0
    deaf = np.bincount(group, weight * apart) / (
        np.bincount(group, weight) + parameters.deafness_db**-2.0
    )
    level = _gaussian_log(apart - deaf[group], spread_db)
    anywhere = _gaussian_log(scan.rssi_dbm[known.heard] - ELSEWHERE_DBM, ELSEWHERE_DB)
    new = parameters.new_share
    told = (1 - new) / new * known.share / USUAL_SHARE * np.exp(level - anywhere)
    fit = np.bincount(group, np.log1p(told))
    return np.asarray(fit - 0.5 * (deaf / parameters.deafness_db) ** 2)


def _gaussian_log(apart: F64, sigma: F64 | float) -> F64:
    return np.asarray(-0.5 * (apart / sigma) ** 2 - np.log(sigma))


def _levels_by_point(scans: Sequence[WifiScans]) -> tuple[dict[int, list[float]], Counter[int]]:
    """Levels of all sightings by address, and on how many walks it was heard."""
    levels: dict[int, list[float]] = defaultdict(list)
    walks: Counter[int] = Counter()
    for wifi in scans:
        numbers = [bssid_number(text) for text in wifi.bssids]
        _, column, rssi_dbm = sightings(wifi)
        for k, level in zip(column.tolist(), rssi_dbm.tolist(), strict=True):
            levels[numbers[k]].append(level)
        walks.update(numbers[k] for k in set(column.tolist()))
    return levels, walks


def _is_passing(number: int, walks: int, of: int) -> bool:
    return bool(number & GROUP_BIT) or bool(number & LOCAL_BIT and walks == 1 and of > 1)


EARTH_M_PER_DEG = 111_195.0
"""Of latitude, on a sphere of 6,371 km: a third of a percent off at worst."""
HIGHEST_DEG = 89.0


@dataclass(frozen=True)
class PositionFindParameters:
    """How far a coarse position tells the building."""

    reach_sigmas: float = parameter(4.0, "", "buildings further away are not asked for", low=1.0)
    around_m: float = parameter(
        500.0, "m", "one building stands for all within this of a phone", low=10.0
    )
    largest_m: float = parameter(
        600.0, "m", "radius of the largest floor that is found from its edge", low=50.0
    )


@dataclass(frozen=True)
class Place:
    """Where a phone believes itself to be; the altitude where it knows one."""

    latitude_deg: float
    longitude_deg: float
    sigma_m: float
    altitude_m: float | None = None
    altitude_sigma_m: float | None = None


@dataclass(frozen=True)
class Site:
    """Where a floor lies: the middle and radius of a disc around it."""

    latitude_deg: float
    longitude_deg: float
    radius_m: float
    altitude_m: float | None = None


def reach_m(place: Place, parameters: PositionFindParameters) -> float:
    """How far away the edge of a floor may be that is asked for."""
    return place.sigma_m * parameters.reach_sigmas


def box_deg(place: Place, parameters: PositionFindParameters) -> tuple[float, float, float, float]:
    """South, west, north and east of where the middles of floors are looked for."""
    high = (reach_m(place, parameters) + parameters.largest_m) / EARTH_M_PER_DEG
    steepest = min(abs(place.latitude_deg) + high, HIGHEST_DEG)
    wide = high / math.cos(math.radians(steepest))
    return (
        place.latitude_deg - high,
        place.longitude_deg - wide,
        place.latitude_deg + high,
        place.longitude_deg + wide,
    )


def distance_m(place: Place, site: Site) -> float:
    """Between the phone and the middle of a floor (flat around the phone)."""
    north = site.latitude_deg - place.latitude_deg
    east = (site.longitude_deg - place.longitude_deg + 180) % 360 - 180
    return EARTH_M_PER_DEG * math.hypot(north, east * math.cos(math.radians(place.latitude_deg)))


def position_log_odds(place: Place, site: Site, parameters: PositionFindParameters) -> float:
    """What a position says for a floor, against being anywhere else around.

    The phone is anywhere on the floor's disc, or anywhere within `around_m`; its error is Gaussian.
    """
    outside_m = max(0.0, distance_m(place, site) - site.radius_m)
    density = site.radius_m**2 + 2 * place.sigma_m**2
    around = parameters.around_m**2 + 2 * place.sigma_m**2
    told = math.log(around / density) - 0.5 * (outside_m / place.sigma_m) ** 2
    if place.altitude_m is not None and place.altitude_sigma_m and site.altitude_m is not None:
        told -= 0.5 * ((place.altitude_m - site.altitude_m) / place.altitude_sigma_m) ** 2
    return told


SURE_ODDS = 19.0
"""Where the vote would name a map it is 95 % sure of it, against the next and against none."""


@dataclass(frozen=True)
class EchoFindParameters:
    """How far echoes tell the floor; least and lead are those of the vote."""

    nearest: int = parameter(20, "", "spots that each footstep is compared with", low=2, high=1000)
    least: float = parameter(
        VoteParameters.least, "", "so far a floor's spots stand out where it is as likely as not"
    )
    lead: float = parameter(
        VoteParameters.lead, "", "so much further in one footstep, 19 times as likely", low=0.001
    )


class NearestSpots(Protocol):
    """The spots of many floors, to be searched."""

    def search(self, vectors: F32, k: int) -> tuple[I64, F32]:
        """Ids (n, k) and similarities (n, k) of the nearest spots of each unit row (n, 128)."""
        ...


@dataclass(frozen=True, eq=False)
class EchoIndex:
    """An index of spots, whose floors they are, and the identity of their encoder.

    `map_of` gives the place in `floors` (ids of maps) of each spot, and -1 for none.
    """

    spots: NearestSpots
    map_of: Callable[[I64], I64]
    floors: tuple[str, ...]
    encoder: str


@dataclass(frozen=True, eq=False)
class EchoEvidence:
    """Log-odds by the id of a floor's map; `silent` for those of the index that stand out nowhere.

    Against being anywhere else.
    """

    odds: dict[str, float]
    silent: float
    indexed: Set[str]

    def of(self, map_id: str) -> float | None:
        """What is said for a floor; None where the index knows nothing of it."""
        return self.odds.get(map_id, self.silent) if map_id in self.indexed else None


def echo_evidence(vectors: F32, index: EchoIndex, parameters: EchoFindParameters) -> EchoEvidence:
    """What features of footsteps (n, 128) say."""
    every = VoteParameters(parameters.least, parameters.lead, candidates=len(index.floors) + 1)
    found = which_map(*index.spots.search(vectors, parameters.nearest), index.map_of, every)
    steepness = math.log(SURE_ODDS) * math.sqrt(len(vectors)) / parameters.lead
    return EchoEvidence(
        {
            index.floors[each.number]: steepness * (each.score - parameters.least)
            for each in found.candidates
            if each.number >= 0
        },
        -steepness * parameters.least,
        frozenset(index.floors),
    )


def unit_rows(vectors: F32) -> F32:
    """Vectors (n, 128), those that are nothing left out, the others scaled to length 1."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    heard = length[:, 0] > 0
    return np.asarray(vectors[heard] / length[heard], dtype=np.float32)
