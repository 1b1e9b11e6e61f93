"""Rows of scores: complete, plain, and true to the functions they come from."""

from __future__ import annotations

import json

import numpy as np
import pytest

from elfslam.base.values import Fixes, Run, Truth
from elfslam.scoring.errors import Alignment, position_errors, summarise
from elfslam.scoring.tables import closure_scores, fix_scores, run_scores


def test_a_row_per_method_and_alignment(run: Run, truth: Truth) -> None:
    rows = run_scores(run, truth)
    keys = [(row["method"], row["alignment"]) for row in rows]
    kinds = ["anchored", "aligned", "aligned with scale"]
    assert keys == [(method, kind) for method in ("dead reckoning", "SLAM") for kind in kinds]
    walk = run.trajectory
    errors = position_errors(walk.t_s, walk.world_from_body, truth, Alignment.ALIGNED)
    assert rows[4]["median_m"] == summarise(errors).median_m
    assert [row["end_error_share"] is None for row in rows] == [False, True, True] * 2


def test_rows_are_json(run: Run, truth: Truth) -> None:
    unknown = np.full(1, np.nan)
    refused = Fixes([3.0], [[np.nan, np.nan]], unknown, np.full((1, 2, 2), np.nan), unknown, [2])
    rows = [*run_scores(run, truth), *closure_scores(run, truth)]
    fixes = fix_scores(refused, truth, np.zeros(3))
    assert json.loads(json.dumps([*rows, *fixes], allow_nan=False)) == [*rows, *fixes]
    assert fixes[0]["median_m"] is None
    none = dict.fromkeys(["OK", "AMBIGUOUS", "NO_ECHO", "SUSPECT"], 0)
    assert fixes[0]["by_status"] == none | {"UNKNOWN_PLACE": 1}


def test_planted_wrong_closures_lower_the_precision_until_the_graph_rejects_them(
    run: Run, truth: Truth
) -> None:
    found, kept = closure_scores(run, truth)
    count = run.closures.i.size
    assert found["precision"] == pytest.approx((count - 2) / count)
    assert (found["count"], kept["count"]) == (
        count,
        int((run.trajectory.closure_weights > 0.5).sum()),
    )
