"""The measurement study in miniature: a few spots, classifiers that hardly learn."""

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.world.room import standing_room
from elfslam.world.world_file import load_world
from studies.spots import (
    COUNT,
    GUESS,
    MEAN_M,
    RECOGNISED,
    Point,
    Recipe,
    Repeat,
    measure_repeat,
    spots_apart,
)


@pytest.mark.parametrize("spacing_m", [0.25, 1.0, 3.0])
def test_neighbours_are_as_far_apart_as_asked_and_where_one_can_stand(spacing_m: float) -> None:
    room = load_world("lab").room
    found = spots_apart(room, spacing_m, 16, np.random.default_rng(0))
    assert found.shape == (16, 2)
    assert standing_room(room, found).all()
    apart_m = np.linalg.norm(found[:, None] - found, axis=2)[np.triu_indices(16, 1)]
    assert apart_m.min() == pytest.approx(spacing_m)
    other = spots_apart(room, spacing_m, 16, np.random.default_rng(1))
    assert not np.array_equal(found, other)


def test_a_room_too_small_for_the_spots_is_refused() -> None:
    with pytest.raises(InputError, match="wanted 16 free places 9 m apart; ask for fewer"):
        spots_apart(load_world("lab").room, 9.0, 16, np.random.default_rng(0))


def test_spots_are_recognised_that_were_learnt() -> None:
    recipe = Recipe(learnt=20, queried=5, batch=20, fewest_steps=40)
    records = measure_repeat(Repeat(Point(COUNT, 2, 1), 0, recipe))
    found = {(each.method, each.metric): each.value for each in records}
    assert found["same visit", RECOGNISED] > 0.8
    assert found["same visit", MEAN_M] < found[GUESS, MEAN_M]
