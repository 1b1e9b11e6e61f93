"""The page of a merged map."""

from pathlib import Path

import numpy as np
import numpy.testing as npt

from elfslam.base.values import FloorMap, Payload
from elfslam.scoring.merged_report import (
    error_tiles,
    sigma_tiles,
    walks_tiles,
    weight_tiles,
    write_merged_report,
)
from elfslam.stages.floormap import MapQuality

QUALITY = MapQuality(
    xy_m=[[0.5, 0.5], [1.5, 0.5], [0.5, 2.5]],
    walks=[1, 2, 3],
    spots=[3, 4, 5],
    weight=[1.0, 0.9, 0.5],
    sigma_m=[0.1, 0.2, 0.9],
    error_m=[np.nan, 0.25, 7.0],
    changed=[False, True, False],
)


def test_squares_lie_where_they_are_and_others_stay_open() -> None:
    heat = walks_tiles(QUALITY).data[0]
    npt.assert_array_equal(heat.x, [0.5, 1.5])
    npt.assert_array_equal(heat.y, [0.5, 2.5])
    npt.assert_array_equal(heat.z, [[1, 2], [3, np.nan]])
    assert (heat.zmin, heat.zmax) == (0, 3)


def test_large_errors_are_drawn_as_two_metres() -> None:
    heat = error_tiles(QUALITY).data[0]
    npt.assert_array_equal(heat.z, [[np.nan, 0.25], [2.0, np.nan]])
    assert sigma_tiles(QUALITY).data[0].zmax == 0.9


def test_what_has_changed_bears_a_cross() -> None:
    crosses = weight_tiles(QUALITY).data[1]
    assert (list(crosses.x), list(crosses.y)) == ([1.5], [0.5])


def test_the_page_names_who_stayed_out_and_escapes_it(tmp_path: Path) -> None:
    floor_map = FloorMap(
        xy_m=np.zeros((2, 2)),
        heading_rad=np.zeros(2),
        walk=[0, 1],
        order=[0, 0],
        covariance_m2=np.tile(np.eye(2), (2, 1, 1)),
        payloads=(Payload("elf", "e", np.eye(2)),),
        parameters_digest="",
        sources=("one", "two"),
    )
    pairs = [{"one": "one", "other": "two", "places": 20, "outcome": "merged"}]
    refused = {"<b>three": "with one: nothing sounds alike"}
    write_merged_report(tmp_path / "r.html", floor_map, QUALITY, pairs, refused)
    text = (tmp_path / "r.html").read_text()
    assert "&lt;b&gt;three" in text
    assert "<b>three" not in text
    assert "nothing sounds alike" in text
