"""The study of held-out walks on the first few of a real floor, and without any."""

import json

import numpy as np
import pytest
from planted_floor import walk_along

from elfslam.base.values import NO_CLOSURES
from elfslam.baselines.floor_places import floor_places
from elfslam.baselines.floor_walks import FloorParameters, corrected, floor_map
from studies import mall_fifths
from studies.located import MEDIAN_M
from studies.mall_fifths import MAPPED_BY, METHODS, SPLITS, STUDY, fifths_records, split_walks
from studies.study import StudyContext


def test_a_few_real_walks_in_small_and_goes_on_where_it_was(shared_data, tmp_path):
    context = StudyContext(shared_data, kept=tmp_path / "kept")
    records = mall_fifths.measure_mall_fifths(context, **STUDY.fast)
    walks = {each.method: each.value for each in records if each.metric == "walks"}
    assert walks == dict.fromkeys(METHODS, 8)
    found = json.loads(context.kept.read_text())
    assert len(found) == SPLITS
    first = next(iter(found))
    context.kept.write_text(json.dumps({first: found[first]}))
    assert mall_fifths.measure_mall_fifths(context, **STUDY.fast) == records


@pytest.mark.parametrize("distance", ["Soerensen", "Euclidean"])
def test_labelled_scans_find_the_walk_that_is_the_same(distance):
    scans = [(w.recording.wifi, w.truth) for w in map(walk_along, (-4.0, 0.0, 4.0))]
    (at,) = mall_fifths.labelled_neighbours(scans[1:2], scans, distance)
    true = scans[1][1].world_from_body[:, :2]
    assert np.median(np.linalg.norm(at - true, axis=1)) < 2.0


def test_every_walk_is_held_out_once():
    walks = [walk_along(y_m) for y_m in np.linspace(-3, 3, 11)]
    held = [number for which in range(SPLITS) for number in split_walks(walks, which)[1]]
    assert sorted(held) == list(range(11))
    assert all(len(split_walks(walks, which)[0]) == count for which, count in ((0, 8), (1, 9)))


def test_every_method_answers_and_its_answers_are_counted():
    walks = [walk_along(-1.0), walk_along(1.0)]
    as_walked = corrected([walk.nodes for walk in walks], NO_CLOSURES)
    parameters = FloorParameters()
    known = floor_map(walks, as_walked, MAPPED_BY, parameters)
    places = floor_places(known, MAPPED_BY, parameters)
    walk = walk_along(0.0, shift_m=(9.0, 9.0))
    found = mall_fifths.positions(walks, places, [walk])
    assert tuple(found) == METHODS
    true = walk.truth.world_from_body[:, :2]
    error_m = np.linalg.norm(found["Wi-Fi, live"][0] - true, axis=1)
    live = {each.metric: each.value for each in fifths_records("F1", "Wi-Fi, live", [error_m])}
    assert live["waypoints"] == 7
    assert 0.5 < live["answered"] < 1
    same = {each.metric: each.value for each in fifths_records("F1", "same", [np.zeros(7)])}
    assert (same[MEDIAN_M], same["answered"]) == (0.0, 1.0)
