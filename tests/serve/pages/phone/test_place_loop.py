"""Located live in the page with no human and no server: a simulated room answers its chirps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from elfslam.base.values import FixStatus
from elfslam.world.world_file import load_world

WORLD, MAP_SEED, SEED, ROUNDS = "studio", 107, 108, 2
ATTEMPTS = 3
HEARD = 0.9
"""Where fewer chirps are heard this machine loses sound, which says nothing of the page."""
LOST = 0.1
"""Where more footsteps have no echo, or one not to be trusted, sound stalled: by chance, or each
time by the page."""

pytestmark = pytest.mark.real


@pytest.fixture(scope="module")
def located(benchmark: Callable[[str], Any], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The walk as the page located it, its errors, and how many footsteps it had."""
    course = benchmark("browser_walk").plan_course(load_world(WORLD), SEED, ROUNDS)
    from tests.serve.pages.phone import located_walk

    folder = tmp_path_factory.mktemp("place")
    address, world_in_map = located_walk.prepared(WORLD, MAP_SEED, folder)
    for _ in range(ATTEMPTS):
        placed = located_walk.walk_once(course, address, folder, SEED)
        lost = np.mean(np.isin(placed.fixes.status, (FixStatus.NO_ECHO, FixStatus.SUSPECT)))
        if placed.heard_share >= HEARD and lost <= LOST:
            break
    if placed.heard_share < HEARD:
        pytest.skip(f"no sound in real time on this machine, {ATTEMPTS} times")
    errors = located_walk.errors_of(placed.fixes, course.truth, world_in_map)
    return placed, errors, course.motion.steps[-1]


def test_the_page_knows_where_it_is_at_every_step(located: Any) -> None:
    placed, errors, steps = located
    known = np.isfinite(placed.fixes.xy_m[:, 0])
    assert known.sum() >= 0.7 * steps
    assert np.mean(placed.fixes.status == FixStatus.OK) > 0.8
    assert errors.median_m < 0.4
    assert errors.quartile3_m < 0.6


def test_it_says_how_sure_it_is(located: Any) -> None:
    _, errors, _ = located
    assert errors.within > 0.5


def test_nothing_is_asked_of_the_network(located: Any) -> None:
    assert located[0].requests == []
