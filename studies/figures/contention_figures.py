"""What phones in one room make of each other, by their number, as curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elfslam.scoring.figures import DEAD_RECKONING, SLAM, TRUTH, WALKS
from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.curves import Curve, curves_figure

MEASURES = {
    "spoiled": ("Frames that others spoiled", "share", ("at will", "in turns")),
    "clean chirps/s": ("Frames worth having, per phone", "per second", ("at will", "in turns")),
    "good fixes/min": ("Fixes within 1 m, per phone", "per minute", ()),
    "median": ("Error of the answered fixes", "median, m", ()),
}
"""What is shown: title, axis and the ways that differ in it (all by default)."""
NOTES = {
    "spoiled": "Others' sound within 10 dB of the own echoes, or louder.",
    "clean chirps/s": "Chirps whose echoes nobody spoiled.",
    "good fixes/min": "One-shot, from half a second and two echoes or more, in a map made before.",
    "median": "Of fixes that said OK.",
}
COLORS = (DEAD_RECKONING, WALKS[3], TRUTH, SLAM)


def contention_page(rows: Sequence[Mapping[str, object]]) -> Page:
    """A page from a row per world, number of phones and way, with `measure` and its interval."""
    panels = []
    for world in dict.fromkeys(str(row["world"]) for row in rows):
        own = [row for row in rows if row["world"] == world]
        for measure, (title, axis, ways) in MEASURES.items():
            drawn = [row for row in own if not ways or row["way"] in ways]
            figure = curves_figure(
                _curves(drawn, measure), "phones in the room", axis, colors=COLORS
            )
            figure.update_xaxes(dtick=1)
            figure.update_yaxes(rangemode="tozero")
            panels.append(Panel(f"{title}, {world}", figure, NOTES[measure]))
    panels.append(Panel("In figures", rows_table([_plain(row) for row in rows]), wide=True))
    subtitle = "Each walks its own way; bands are 95 % over rooms' walks"
    return Page("Phones that take turns", subtitle, panels)


def _curves(rows: Sequence[Mapping[str, object]], measure: str) -> dict[str, Curve]:
    curves = {}
    for way in dict.fromkeys(str(row["way"]) for row in rows):
        own = [row for row in rows if row["way"] == way and row[measure] is not None]
        ends = [str(row[f"{measure}, 95 %"]).split(" to ") for row in own]
        low, high = (np.array([float(end[k]) for end in ends]) for k in range(2))
        x = np.array([float(str(row["phones"])) for row in own])
        curves[way] = Curve(x, np.array([float(str(row[measure])) for row in own]), low, high)
    return curves


def _plain(row: Mapping[str, object]) -> dict[str, object]:
    return {name: value for name, value in row.items() if "95 %" not in name}
