"""Floors against the truth, with planted levels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.building import BuildingFloor, FloorsVisited
from elfslam.base.errors import InputError
from elfslam.base.values import (
    NO_CLOSURES,
    Fixes,
    LevelPassage,
    Levels,
    MeanSimilarity,
    Odometry,
    Run,
    Trajectory,
    Truth,
)
from elfslam.scoring.levels import (
    fix_level_scores,
    floor_scores,
    level_scores,
    level_shift,
    on_right_floor,
)

T_S = np.arange(201) * 0.5
STAIRS, LIFT, _ = LevelPassage
POSES = np.column_stack([T_S, np.sin(T_S / 5), np.zeros(201)])


def levels(*rows: tuple[float, float, LevelPassage | None]) -> Levels:
    t_s, level, passages = zip(*rows, strict=True)
    return Levels(np.array(t_s), np.array(level), passages)


TRUE = levels((0, 2, None), (40, np.nan, STAIRS), (50, 3, None), (80, np.nan, LIFT), (90, 2, None))
TRUTH = Truth(T_S, POSES, TRUE)
FOUND = levels((0, 0, None), (41, np.nan, STAIRS), (50, 1, None))


def run(visited: Levels | None, poses: F64 = POSES) -> Run:
    floors = tuple(BuildingFloor(level, 4.0 * level) for level in range(4))
    return Run(
        "walk",
        Odometry(T_S, poses, np.zeros((200, 3))),
        MeanSimilarity(np.zeros((200, 1)), "motion"),
        NO_CLOSURES,
        Trajectory(T_S, poses, np.zeros((201, 3, 3)), np.zeros(0), "OK"),
        None,
        None,
        None,
        visited=None if visited is None else FloorsVisited(visited, floors),
    )


def test_levels_are_counted_from_the_truth_s_first() -> None:
    assert level_shift(run(FOUND), TRUTH) == 2
    (row,) = level_scores(run(FOUND), TRUTH)
    assert (row["changes"], row["found"], row["false"], row["kind_right"]) == (2, 1, 0, 1)
    # Of 80 s on floors the last 10 are wrong; the first of the stairs is no floor.
    assert row["floor_right"] == pytest.approx(70 / 80, abs=0.01)
    assert row["floor_wrong"] == pytest.approx(10 / 80, abs=0.01)
    assert row["floor_unknown"] == 0


def test_what_is_found_where_nothing_was_is_false() -> None:
    false = levels((0, 2, None), (60, np.nan, LIFT), (70, 3, None))
    (row,) = level_scores(run(false), TRUTH)
    assert (row["found"], row["false"], row["kind_right"]) == (0, 1, 0)


def test_a_change_found_in_two_pieces_is_one_right_change() -> None:
    split = levels(
        (0, 2, None), (41, np.nan, STAIRS), (44, 2, None), (46, np.nan, STAIRS), (50, 3, None)
    )
    (row,) = level_scores(run(split), TRUTH)
    assert (row["changes"], row["found"], row["false"], row["kind_right"]) == (2, 1, 0, 1)


def test_a_walk_on_one_floor_has_no_rows() -> None:
    assert level_scores(run(None), TRUTH) == floor_scores(run(None), TRUTH) == []
    assert level_scores(run(FOUND), replace(TRUTH, levels=None)) == []
    assert level_shift(run(None), TRUTH) == 0


def test_errors_are_those_of_each_floor() -> None:
    bent = POSES.copy()
    bent[(T_S > 50) & (T_S < 80), 1] += 1.0
    below, above = floor_scores(run(TRUE, bent), TRUTH)
    assert (below["level"], above["level"]) == (2, 3)
    assert below["median_m"] < 0.5 < above["median_m"]


FIXES = Fixes(
    T_S, POSES[:, :2], POSES[:, 2], np.zeros((201, 2, 2)), np.ones(201), np.zeros(201, int)
)


def test_fixes_are_right_wrong_or_silent_about_the_floor() -> None:
    said = np.select([T_S < 20, T_S < 40], [0.0, np.nan], 1.0)
    (row,) = fix_level_scores(replace(FIXES, level=said), TRUTH, 2)
    assert row["floor_right"] == pytest.approx(50 / 80, abs=0.01)
    assert row["floor_unknown"] == pytest.approx(20 / 80, abs=0.01)
    right = on_right_floor(replace(FIXES, level=said), TRUTH, 2)
    assert set(right.t_s) == {t for t in T_S if t < 20 or 50 <= t < 80}
    assert fix_level_scores(FIXES, TRUTH) == []
    assert on_right_floor(FIXES, TRUTH) is FIXES


def test_a_truth_without_levels_cannot_judge_them() -> None:
    with pytest.raises(InputError, match=r"no truth_levels\.csv"):
        fix_level_scores(replace(FIXES, level=np.zeros(201)), replace(TRUTH, levels=None))
