"""What a fleet waits for as its load grows, as curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.curves import Curve, curves_figure

SHORTEST_S, LONGEST_S = 1e-4, 86_400.0
"""Less and more is drawn there: the axis is logarithmic, and after a day nobody waits any more."""


def fleet_page(
    rows: Sequence[Mapping[str, object]],
    late_s: Mapping[str, Mapping[int, float]],
    limits_s: Mapping[str, float],
) -> Page:
    """A page from what 99 of 100 requests wait at most (s), by station and times the load."""
    times = sorted({many for each in late_s.values() for many in each})
    curves = {
        f"{name} (limit {limits_s[name]:g} s)": Curve(
            np.array(list(each), float), np.clip(list(each.values()), SHORTEST_S, LONGEST_S)
        )
        for name, each in late_s.items()
    }
    figure = curves_figure(curves, "times the load of a day", "99 % wait less, s", ticks=times)
    figure.update_yaxes(type="log", exponentformat="power")
    note = "A simulated day, first come first served; what waits beyond its limit has broken."
    panels = [
        Panel("What breaks first", figure, note, wide=True),
        Panel("In figures", rows_table(rows), wide=True),
    ]
    return Page("A thousand buildings", "One machine of two cores, one link of 1 Gbit/s", panels)
