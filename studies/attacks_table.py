"""Rows and page of the attacks: a row per attack, level and mode, and per honest kind of walk."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.attack_figures import shares_figure
from studies.figures.dots import dots_by, dots_figure
from studies.finding import Row
from studies.repeats import Numbers

HONEST = "honest"
ALL = "all but other phones"
OTHERS = "other phone"
MODES = {"track": "tracker", "one-shot": "one-shot"}
COLUMNS = (
    "walks", "detected", "delay median (s)", "delay 95 % (s)", "told", "refused", "wrong",
    "wrong unchecked", "off before told (m)", "off (m)", "off unchecked (m)", "hours", "alarms",
    "per hour", "per hour from", "per hour to",
)  # fmt: skip
NOTE = (
    "Share of the fixes under attack that are OK and more than a metre off, over all walks; "
    "attackers that reach the ear straight are the worst case."
)


def attacks_rows(numbers: Sequence[Numbers]) -> list[Row]:
    """A row per attack, level and mode, then one per kind of honest walk and mode."""
    keys = dict.fromkeys(key.rpartition("|")[0] for each in numbers for key in each)
    attacks = [_attack_row(numbers, key) for key in keys if not key.startswith(HONEST)]
    kinds = [key for key in keys if key.startswith(HONEST)]
    honest = [_honest_row(numbers, [key], key.split("|")[1]) for key in kinds]
    for mode in dict.fromkeys(key.split("|")[2] for key in kinds):
        alone = [key for key in kinds if key.endswith(mode) and OTHERS not in key]
        honest += [_honest_row(numbers, alone, ALL)] if alone else []
    return [*attacks, *honest]


def _row(what: str, level_db: float | None, mode: str, values: Row) -> Row:
    head: Row = {"what": what, "level (dB)": level_db, "mode": mode}
    return head | {name: values.get(name) for name in COLUMNS}


def _attack_row(numbers: Sequence[Numbers], key: str) -> Row:
    what, level_db, mode = key.split("|")
    walks = [each for each in numbers if f"{key}|delay" in each]

    def every(name: str) -> list[float]:
        return [each[f"{key}|{name}"] for each in walks]

    delays_s = np.array(every("delay"))
    values: Row = {
        "walks": len(walks),
        "detected": round(float(np.isfinite(delays_s).mean()), 3),
        "delay median (s)": _quantile(delays_s, 0.5),
        "delay 95 % (s)": _quantile(delays_s, 0.95),
        **{
            name: round(float(np.mean(every(name))), 3)
            for name in ("told", "refused", "wrong", "wrong unchecked")
        },
        "off before told (m)": round(max(every("off before")), 2),
        "off (m)": round(max(every("off")), 2),
        "off unchecked (m)": round(max(every("off unchecked")), 2),
    }
    return _row(what, float(level_db), mode, values)


def _quantile(delays_s: np.ndarray, share: float) -> float | None:
    """The delay (s) within which that share of the walks was told; None where fewer ever were."""
    found = float(np.quantile(delays_s, share, method="inverted_cdf"))
    return round(found, 2) if np.isfinite(found) else None


def _honest_row(numbers: Sequence[Numbers], keys: Sequence[str], what: str) -> Row:
    def every(name: str) -> list[float]:
        return [
            each[f"{key}|{name}"] for each in numbers for key in keys if f"{key}|{name}" in each
        ]

    alarms, hours = sum(every("alarms")), sum(every("hours"))
    low, high = poisson_interval(int(alarms))
    values: Row = {
        "walks": len(every("hours")),
        "told": round(float(np.mean(every("told"))), 4),
        "refused": round(float(1 - np.mean(every("answered")) - np.mean(every("told"))), 3),
        "hours": round(hours, 2),
        "alarms": int(alarms),
        "per hour": round(alarms / hours, 2),
        "per hour from": round(low / hours, 2),
        "per hour to": round(high / hours, 2),
    }
    return _row(f"{HONEST}: {what}", None, keys[0].split("|")[2], values)


def poisson_interval(count: int) -> tuple[float, float]:
    """Between which expected counts a counted one lies with 95 % (exact, Garwood 1936)."""
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    return float(low), float(stats.chi2.ppf(0.975, 2 * count + 2) / 2)


def attacks_page(rows: Sequence[Row]) -> Page:
    """What attacks move with and without the checks, how often they are told, and false alarms."""
    attacks = [row for row in rows if not str(row["what"]).startswith(HONEST)]
    honest = [row for row in rows if str(row["what"]).startswith(HONEST)]
    panels = []
    for mode, title in MODES.items():
        here = [row for row in attacks if row["mode"] == mode]
        if here:
            panels += _mode_panels(here, title)
    panels += [_alarms(honest), Panel("Every row", rows_table(list(rows)), wide=True)]
    subtitle = "a simulated stranger in a mapped place, with an attacker from a moment on"
    return Page("Attacks on a phone that is located", subtitle, panels)


def _mode_panels(rows: Sequence[Row], title: str) -> list[Panel]:
    shares = {
        "wrong, unchecked": "wrong unchecked", "wrong, checked": "wrong",
        "told SUSPECT": "told", "refused otherwise": "refused",
    }  # fmt: skip
    names = [str(row["what"]) for row in rows]
    levels = [f"{row['level (dB)']:g} dB" for row in rows]
    values = {name: [float(str(row[column])) for row in rows] for name, column in shares.items()}
    return [Panel(f"What attacks do: {title}", shares_figure(names, levels, values), NOTE, True)]


def _alarms(rows: Sequence[Row]) -> Panel:
    found = dots_by(
        lambda row: MODES[str(row["mode"])],
        lambda row: str(row["what"]).removeprefix(f"{HONEST}: "),
        rows, "per hour", "per hour from", "per hour to",
    )  # fmt: skip
    dots = {title: found.get(title, []) for title in MODES.values()}
    figure = dots_figure(dots, "alarms per hour of honest walking", "")
    note = "With the exact 95 % interval of a count."
    return Panel("False alarms", figure, note, wide=True)
