"""Similarity against displacement: how far from where it was mapped a place is known again.

A phone is moved from half a centimetre to a metre in some direction, and nothing else changes. In
the measured room a microphone moved beside a fixed source, which is as much as a phone that moves
half as far. Features lose what the places have in common, as those of a walk do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from elfslam.base.arrays import F32, Bool
from elfslam.stages.feature import Encoder
from studies.plain_features import compared_encoders
from studies.real_rooms import own
from studies.realism import Place, echoes_of, measured_places, places_along
from studies.results import Record
from studies.study import Study, StudyContext

WORLDS = ("living_room", "office", "mall")
PLACES = 100
MOVED_M = (0.005, 0.0125, 0.025, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
ELSEWHERE_M = 2.0
"""Places so far from each other are others."""
FALSE_POSITIVES = 0.01
RECALL = "recall at 1 % false positives"


def measure_displacement(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    places: int = PLACES,
    encoders: Mapping[str, Encoder] | None = None,
) -> list[Record]:
    """Recall by room, feature and displacement (the condition).

    That is the share more similar than all but 1 % of places two metres away or more. Without
    `data` there is no measured room. Places along the routes by seed 0. `encoders` are measured by
    name beside the shipped one and the spectrograms.
    """
    compared = {**compared_encoders(), **(encoders or {})}
    records: list[Record] = []
    for k, world in enumerate(worlds):
        context.announce(world.replace("_", " "), k / len(worlds))
        of = Record("", world=world, scenario="controlled", seeds="0")
        records += _records(of, places_along(world, "diffuse", places, MOVED_M), compared)
    for place in [] if context.data is None else measured_places(context.data / "rirs"):
        of = Record("", world=f"measured room, {place.name}")
        records += _records(of, place, compared)
    return records


def _records(of: Record, place: Place, encoders: Mapping[str, Encoder]) -> list[Record]:
    here = echoes_of(place.responses)
    known = {name: own(encoder.embed(here)) for name, encoder in encoders.items()}
    other, records = _other(place), []
    for far_m, responses in place.moved.items():
        moved, at = echoes_of(responses), replace(of, condition=f"{100 * far_m:g} cm")
        for name, encoder in encoders.items():
            found = recall(known[name], own(encoder.embed(moved)), other)
            records.append(replace(at, method=name, metric=RECALL, value=found))
    return records


def _other(place: Place) -> Bool:
    if place.xy_m is None:
        return ~np.eye(len(place.responses), dtype=bool)
    return np.asarray(cdist(place.xy_m, place.xy_m) > ELSEWHERE_M)


def recall(here: F32, moved: F32, other: Bool) -> float:
    """Share of places (n) that, once moved, are more similar than all but 1 % of `other` (n, n)."""
    cosine = moved @ here.T
    return float(np.mean(np.diag(cosine) > np.quantile(cosine[other], 1 - FALSE_POSITIVES)))


STUDY = Study(
    "How far from where it was mapped is a place known again by one echo?",
    measure_displacement, minutes=6, encoders=True,
    fast={"worlds": ("studio",), "places": 24},
)  # fmt: skip
