"""What a fix costs, on small maps."""

from __future__ import annotations

import numpy as np

from studies.finding import Given
from studies.localization_cost import grid_map, map_bytes, measure_localization_cost


def test_every_way_is_timed_for_every_size() -> None:
    rows = measure_localization_cost(Given(), spots=(400, 900), repeats=2)
    assert [row["spots"] for row in rows] == [400] * 4 + [900] * 4
    assert all(float(str(row["value"])) > 0 for row in rows)
    small, large = (row["value"] for row in rows if row["unit"] == "MB")
    assert float(str(large)) > 2 * float(str(small))


def test_a_map_of_4000_spots_fits_in_four_megabytes() -> None:
    floor_map = grid_map(4000, np.random.default_rng(0))
    assert 4000 * 128 * 4 < map_bytes(floor_map) < 4e6
    steps_m = np.linalg.norm(np.diff(floor_map.xy_m, axis=0), axis=1)
    np.testing.assert_allclose(steps_m, 0.1)
