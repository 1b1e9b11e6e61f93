"""What a fix costs, on small maps."""

import numpy as np

from studies.localization_cost import MEMORY, STUDY, grid_map, map_bytes, measure_localization_cost
from studies.study import StudyContext


def test_every_way_is_timed_and_memory_grows_with_the_map() -> None:
    records = measure_localization_cost(StudyContext(), **STUDY.fast)
    assert all(each.value > 0 for each in records)
    small, large = (each.value for each in records if each.metric == MEMORY)
    assert large > 2 * small


def test_a_map_of_4000_spots_fits_in_four_megabytes() -> None:
    floor_map = grid_map(4000, np.random.default_rng(0))
    assert 4000 * 128 * 4 < map_bytes(floor_map) < 4e6
    steps_m = np.linalg.norm(np.diff(floor_map.xy_m, axis=0), axis=1)
    np.testing.assert_allclose(steps_m, 0.1)
