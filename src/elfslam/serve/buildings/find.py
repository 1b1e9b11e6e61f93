"""Which floor a phone is on: what each sense says, added up by one rule.

Every sense gives log-odds for a floor, against being anywhere else; a sense that cannot know of a
floor says nothing of it. Their sum, each bounded, gives the share of each floor and of "elsewhere"
(odds 1). The best floor is the answer only where its share is large and no sense knows another
building instead; nothing is ever guessed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from elfslam.base.arrays import F32
from elfslam.base.parameters import parameter
from elfslam.serve.buildings.senses import (
    EchoEvidence,
    EchoFindParameters,
    Place,
    PositionFindParameters,
    Site,
    WifiFindParameters,
    position_log_odds,
)


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
    denying_log_odds: float = parameter(
        5.0, "", "with so much a sense knows another building, or that it is not this", low=0.0
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
    echo: EchoEvidence | None = None


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
    said = {floor.number: senses(floor, evidence, parameters) for floor in known}
    odds = np.array([0.0, *(sum(each or 0.0 for each in said[floor.number]) for floor in known)])
    share = np.exp(odds - odds.max())
    share /= share.sum()
    order = sorted(range(len(known)), key=lambda k: (-share[k + 1], known[k].number))
    told = tuple(
        Candidate(known[k], float(share[k + 1]))
        for k in order[: rule.most_candidates]
        if share[k + 1] >= rule.least_share
    )
    if not told or share[0] >= rule.elsewhere_share:
        return Answer(Found.UNKNOWN_PLACE, told)
    sure = told[0].share >= rule.sure_share and not _denied(told[0].floor, known, said, rule)
    return Answer(Found.OK if sure else Found.AMBIGUOUS, told)


def senses(
    floor: KnownFloor, evidence: Evidence, parameters: FindParameters
) -> tuple[float | None, ...]:
    """What Wi-Fi, position and echoes say for a floor; None where one says nothing of it."""
    wifi = place = echo = None
    if evidence.wifi is not None and floor.has_wifi:
        wifi = evidence.wifi.get(floor.number, evidence.wifi_silent)
    if evidence.place is not None:
        place = position_log_odds(evidence.place, floor.site, parameters.position)
    if evidence.echo is not None:
        echo = evidence.echo.of(floor.map_id)
    most = parameters.rule.most_log_odds
    return tuple(
        None if each is None else max(-most, min(most, each)) for each in (wifi, place, echo)
    )


def _denied(
    best: KnownFloor,
    known: Sequence[KnownFloor],
    said: Mapping[int, tuple[float | None, ...]],
    rule: RuleParameters,
) -> bool:
    """Whether a sense knows another building, and that it is not this one, or nothing of this."""
    for sense, here in enumerate(said[best.number]):
        others = (said[each.number][sense] for each in known if each.building != best.building)
        another = max((odds for odds in others if odds is not None), default=0.0)
        if another >= rule.denying_log_odds and (here is None or here <= -rule.denying_log_odds):
            return True
    return False
