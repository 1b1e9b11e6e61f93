"""Likeness against displacement: how far from where it was heard an echo is known again.

A phone is moved from half a centimetre to a metre in some direction, and nothing else changes. In
the measured room a microphone moved beside a fixed source, which is as much as a phone that moves
half as far. Features lose what the places have in common, as those of a walk do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from scipy.spatial.distance import cdist

from elfslam.base.arrays import F32, Bool
from elfslam.line.feature import Encoder
from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.clouds import COLORS
from studies.figures.curves import Curve, curves_figure
from studies.finding import Finding, Given, Row
from studies.plain_features import compared_encoders
from studies.real_rooms import own
from studies.realism import Place, echoes_of, measured_places, places_along
from studies.room_statistics import contrast

WORLDS = ("living_room", "office", "mall")
PLACES = 100
MOVED_M = (0.005, 0.0125, 0.025, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
ELSEWHERE_M = 2.0
"""Places so far from each other are others."""
FALSE_POSITIVES = 0.01
LIKENESS, RECALL, MOVED, MEASURED = "likeness", "recall", "moved (cm)", "measured"
NOTES = {
    LIKENESS: "Mean cosine: 1 for the same echo, 0 for those of other places. Diamonds: measured.",
    RECALL: "More alike than all but 1 % of the places that are 2 m away or more.",
}


def measure_displacement(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    places: int = PLACES,
    encoders: Mapping[str, Encoder] | None = None,
) -> Finding:
    """A row per room, measure and displacement: likeness and recall by feature; curves by room.

    Likeness is the mean cosine, less that of other places, over what is then left. Without `data`
    there is no measured room. Places along the routes by seed 0. `encoders` are measured by name
    beside the shipped one and the spectrograms.
    """
    compared = {**compared_encoders(), **(encoders or {})}
    found = [] if given.data is None else list(measured_places(given.data / "rirs"))
    for k, world in enumerate(worlds):
        given.announce(world.replace("_", " "), k / len(worlds))
        found.append(places_along(world, "diffuse", places, MOVED_M))
    given.announce("features", 0.8)
    rows = [row for place in found for row in _rows(place, compared)]
    given.announce("done", 1.0)
    return Finding(rows, _page(rows, list(compared)))


def _rows(place: Place, encoders: Mapping[str, Encoder]) -> list[Row]:
    here, other = echoes_of(place.responses), _other(place)
    known = {name: own(encoder.embed(here)) for name, encoder in encoders.items()}
    rows: list[Row] = []
    for far_m, responses in place.moved.items():
        moved = echoes_of(responses)
        again = {name: own(encoder.embed(moved)) for name, encoder in encoders.items()}
        for measure, by in ((LIKENESS, contrast), (RECALL, partial(recall, other=other))):
            rows.append(
                {
                    "room": place.name,
                    "measure": measure,
                    MOVED: 100 * far_m,
                    **{name: round(by(known[name], again[name]), 3) for name in encoders},
                    "sound": place.kind,
                }
            )
    return rows


def recall(here: F32, moved: F32, other: Bool) -> float:
    """How many places (n) are as alike, once moved, as no more than 1 % of `other` pairs (n, n)."""
    alike = moved @ here.T
    return float(np.mean(np.diag(alike) > np.quantile(alike[other], 1 - FALSE_POSITIVES)))


def _other(place: Place) -> Bool:
    if place.xy_m is None:
        return ~np.eye(len(place.responses), dtype=bool)
    return np.asarray(cdist(place.xy_m, place.xy_m) > ELSEWHERE_M)


def _page(rows: Sequence[Row], features: Sequence[str]) -> Page:
    simulated = dict.fromkeys(str(row["room"]) for row in rows if row["sound"] != MEASURED)
    panels = [_panel(rows, room, measure, features) for measure in NOTES for room in simulated]
    return Page(
        "Likeness against displacement",
        "single echoes of one phone on one day, moved in some direction",
        [*panels, Panel("Figures", rows_table(rows), wide=True)],
    )


def _panel(rows: Sequence[Row], room: str, measure: str, features: Sequence[str]) -> Panel:
    """A curve for each feature, and what they have in the measured room."""
    of_measure = [row for row in rows if row["measure"] == measure]
    here = [row for row in of_measure if row["room"] == room]
    curves = {
        name: Curve(*np.array([[row[MOVED], row[name]] for row in here], dtype=np.float64).T)
        for name in features
    }
    ticks = [100 * far for far in MOVED_M]
    figure = curves_figure(curves, MOVED, measure, ticks=ticks)
    figure.update_yaxes(range=[-0.05, 1.02])
    for color, name in zip(COLORS, curves, strict=False):
        measured = [(row[MOVED], row[name]) for row in of_measure if row["sound"] == MEASURED]
        x, y = zip(*measured, strict=True) if measured else ((), ())
        marker = {"size": 9, "symbol": "diamond", "color": color}
        figure.add_scatter(x=x, y=y, mode="markers", marker=marker, showlegend=False)
    return Panel(f"{room}: {measure}", figure, NOTES[measure])
