"""Which floor a phone is on: what each sense says, added up by one rule.

Every sense gives log-odds for a floor, against being anywhere else; a sense that cannot know of a
floor says nothing of it. Their sum, each bounded, gives the share of each floor and of "elsewhere"
(odds 1). The best floor is the answer only where its share is large; nothing is ever guessed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from elfslam.base.arrays import F32
from elfslam.base.parameters import parameter
from elfslam.serve.buildings.echoes import EchoFindParameters
from elfslam.serve.buildings.position import (
    Place,
    PositionFindParameters,
    Site,
    position_log_odds,
)
from elfslam.serve.buildings.wifi import WifiFindParameters


class Found(StrEnum):
    """What came of it."""

    OK = "OK"
    AMBIGUOUS = "AMBIGUOUS"
    UNKNOWN_PLACE = "UNKNOWN_PLACE"


@dataclass(frozen=True)
class RuleParameters:
    """When an answer is one."""

    sure_share: float = parameter(0.95, "", "of the best floor, to be the answer", low=0.5)
    elsewhere_share: float = parameter(
        0.5, "", "from here on the place is unknown", low=0.05, high=1.0
    )
    most_log_odds: float = parameter(30.0, "", "of one sense, either way", low=1.0)
    most_candidates: int = parameter(10, "", "are told", low=1, high=1000)
    least_share: float = parameter(0.001, "", "of a candidate that is told", low=0.0, high=0.5)


@dataclass(frozen=True)
class FindParameters:
    """All parameters of finding a floor."""

    wifi: WifiFindParameters = field(default_factory=WifiFindParameters)
    position: PositionFindParameters = field(default_factory=PositionFindParameters)
    echo: EchoFindParameters = field(default_factory=EchoFindParameters)
    rule: RuleParameters = field(default_factory=RuleParameters)


@dataclass(frozen=True, eq=False)
class Asked:
    """What a phone tells: levels (dBm) by address, where it believes to be, features it hears."""

    wifi: Mapping[int, float] = field(default_factory=dict)
    place: Place | None = None
    vectors: F32 | None = None
    encoder: str = ""


@dataclass(frozen=True)
class KnownFloor:
    """A floor that may be the one."""

    number: int
    building: str
    level: int
    map_id: str
    revision: int
    site: Site
    has_wifi: bool


@dataclass(frozen=True, eq=False)
class Evidence:
    """What each sense says of floors by their number; None where it was not asked.

    `wifi_silent` is what it says of a floor with Wi-Fi that knows nothing of what was heard.
    """

    wifi: Mapping[int, float] | None = None
    wifi_silent: float = 0.0
    place: Place | None = None
    echo: Mapping[int, float] | None = None


@dataclass(frozen=True)
class Candidate:
    """A floor and its share of the belief."""

    floor: KnownFloor
    share: float


@dataclass(frozen=True)
class Answer:
    """What is said: candidates best first, and whether the first is the answer."""

    status: Found
    candidates: tuple[Candidate, ...]


def decide(floors: Iterable[KnownFloor], evidence: Evidence, parameters: FindParameters) -> Answer:
    """The answer from what the senses say of some floors."""
    known, rule = list(floors), parameters.rule
    odds = [0.0, *(log_odds(floor, evidence, parameters) for floor in known)]
    weight = np.exp(np.array(odds) - max(odds))
    share = weight / weight.sum()
    order = sorted(range(len(known)), key=lambda k: (-share[k + 1], known[k].number))
    told = tuple(
        Candidate(known[k], float(share[k + 1]))
        for k in order[: rule.most_candidates]
        if share[k + 1] >= rule.least_share
    )
    if not told or share[0] >= rule.elsewhere_share:
        return Answer(Found.UNKNOWN_PLACE, told)
    return Answer(Found.OK if told[0].share >= rule.sure_share else Found.AMBIGUOUS, told)


def log_odds(floor: KnownFloor, evidence: Evidence, parameters: FindParameters) -> float:
    """What all senses together say for a floor."""
    said = []
    if evidence.wifi is not None and floor.has_wifi:
        said.append(evidence.wifi.get(floor.number, evidence.wifi_silent))
    if evidence.place is not None:
        said.append(position_log_odds(evidence.place, floor.site, parameters.position))
    if evidence.echo is not None:
        said.append(evidence.echo.get(floor.number, 0.0))
    most = parameters.rule.most_log_odds
    return float(np.clip(said, -most, most).sum())
