"""The study of held-out walks on the first few of a real floor, and without any."""

from __future__ import annotations

import json

import numpy as np
import pytest
from planted_floor import walk_along

from elfslam.base.errors import InputError
from elfslam.base.values import NO_CLOSURES
from elfslam.baselines.floor_places import floor_places
from elfslam.baselines.floor_walks import FloorParameters, floor_map
from elfslam.baselines.walks_graph import corrected
from studies.finding import Given
from studies.labelled_neighbours import labelled_neighbours
from studies.mall_fifths import (
    MAPPED_BY,
    METHODS,
    SPLITS,
    fifths_row,
    measure_mall_fifths,
    positions,
    split_walks,
)


def test_real_walks_are_wanted():
    with pytest.raises(InputError, match="wanted real walks"):
        measure_mall_fifths(Given())


def test_a_few_real_walks_in_small_and_goes_on_where_it_was(shared_data, tmp_path):
    kept = tmp_path / "kept"
    small = {"floors": ("F1",), "most_walks": 8}
    finding = measure_mall_fifths(Given(shared_data, kept=kept), **small)
    assert [row["method"] for row in finding.rows] == list(METHODS)
    assert all(row["used to"] == "develop" and row["walks"] == 8 for row in finding.rows)
    found = json.loads(kept.read_text())
    assert len(found) == 5
    first = next(iter(found))
    kept.write_text(json.dumps({first: found[first]}))
    assert measure_mall_fifths(Given(shared_data, kept=kept), **small).rows == finding.rows


@pytest.mark.parametrize("distance", ["Soerensen", "Euclidean"])
def test_labelled_scans_find_the_walk_that_is_the_same(distance):
    scans = [(w.recording.wifi, w.truth) for w in map(walk_along, (-4.0, 0.0, 4.0))]
    (at,) = labelled_neighbours(scans[1:2], scans, distance)
    true = scans[1][1].world_from_body[:, :2]
    assert np.median(np.linalg.norm(at - true, axis=1)) < 2.0


def test_every_walk_is_held_out_once():
    walks = [walk_along(y_m) for y_m in np.linspace(-3, 3, 11)]
    held = [number for which in range(SPLITS) for number in split_walks(walks, which)[1]]
    assert sorted(held) == list(range(11))
    assert all(len(split_walks(walks, which)[0]) == count for which, count in ((0, 8), (1, 9)))


def test_every_method_answers_and_a_row_counts_it():
    walks = [walk_along(-1.0), walk_along(1.0)]
    as_walked = corrected([walk.nodes for walk in walks], NO_CLOSURES)
    parameters = FloorParameters()
    known = floor_map(walks, as_walked, MAPPED_BY, parameters)
    places = floor_places(known, MAPPED_BY, parameters)
    walk = walk_along(0.0, shift_m=(9.0, 9.0))
    found = positions(walks, places, [walk])
    assert tuple(found) == METHODS
    row = fifths_row("F1", "Wi-Fi, live", [walk], found["Wi-Fi, live"])
    assert row["waypoints"] == 7
    assert 50 < row["answered (%)"] < 100
    assert fifths_row("F1", "same", [walk], [walk.truth.world_from_body[:, :2]])[
        "median (m)"
    ].startswith("0.0 [")
