"""Floors against the truth: right in what share of the time, changes found and false, map errors.

Levels count from the floor of the start unless a map says otherwise, so those of a run are moved to
the truth's first.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Fixes, Levels, Run, Truth
from elfslam.scoring.errors import Alignment, ScoreRow, summarise, walk_errors
from elfslam.stages.levels import passages_of

STEP_S = 0.5


def level_scores(run: Run, truth: Truth) -> list[ScoreRow]:
    """One row about the levels of a run; none where run or truth has none."""
    if run.visited is None or truth.levels is None:
        return []
    return [score_levels(run.visited.levels, truth.levels, run.trajectory.t_s)]


def score_levels(found: Levels, true: Levels, footsteps_t_s: F64) -> ScoreRow:
    """About the levels of a walk with footsteps at the times (n), whichever floor it calls 0."""
    t_s = np.arange(footsteps_t_s[0], footsteps_t_s[-1], STEP_S)
    said = found.at(t_s) + _shift(found, true, footsteps_t_s)
    by_found, by_true = list(passages_of(found)), list(passages_of(true))
    met = [(a, b) for a in by_true for b in by_found if min(a[1], b[1]) > max(a[0], b[0])]
    return {
        **_shares(said, true.at(t_s)),
        "changes": len(by_true),
        "found": len({a[0] for a, _ in met}),
        "false": len(by_found) - len({b[0] for _, b in met}),
        "kind_right": len({a[0] for a, b in met if a[2] == b[2]}),
    }


def level_shift(run: Run, truth: Truth) -> int:
    """How many floors the truth's level 0 lies over that of a run; 0 where nobody knows."""
    if run.visited is None or truth.levels is None:
        return 0
    return _shift(run.visited.levels, truth.levels, run.trajectory.t_s)


def _shift(found: Levels, true: Levels, t_s: F64) -> int:
    ahead = true.at(t_s) - found.at(t_s)
    known = ahead[np.isfinite(ahead)]
    return int(known[0]) if len(known) else 0


def floor_scores(run: Run, truth: Truth) -> list[ScoreRow]:
    """A row per floor of a run: its errors after the whole was aligned."""
    if run.visited is None:
        return []
    walk = run.trajectory.t_s, run.trajectory.world_from_body
    t_s, errors_m = walk_errors(*walk, truth, Alignment.ALIGNED)
    level = run.visited.levels.at(t_s)
    floors = np.unique(level[np.isfinite(level)])
    return [{"level": int(each), **asdict(summarise(errors_m[level == each]))} for each in floors]


def fix_level_scores(fixes: Fixes, truth: Truth, shift: int = 0) -> list[ScoreRow]:
    """One row about the levels of fixes, which lie `shift` floors below those of the truth.

    None where the fixes are of one floor. Raises InputError where the truth knows no levels.
    """
    if fixes.level is None:
        return []
    if truth.levels is None:
        raise InputError("truth: has no truth_levels.csv, and the fixes have levels; put one there")
    return [_shares(fixes.level + shift, truth.levels.at(fixes.t_s))]


def on_right_floor(fixes: Fixes, truth: Truth, shift: int = 0) -> Fixes:
    """The fixes whose floor is right; all where nobody says floors."""
    if fixes.level is None or truth.levels is None:
        return fixes
    return fixes.chosen(fixes.level + shift == truth.levels.at(fixes.t_s))


def _shares(said: F64, true: F64) -> ScoreRow:
    """Of the moments on a floor: on which share the level is right, wrong, and not said."""
    on_floor = np.isfinite(true)
    count = max(int(on_floor.sum()), 1)
    right, unknown = (
        float((each & on_floor).sum() / count) for each in (said == true, np.isnan(said))
    )
    return {
        "floor_right": round(right, 4),
        "floor_wrong": round(1 - right - unknown, 4),
        "floor_unknown": round(unknown, 4),
    }
