"""The measurement study in miniature: a few spots, classifiers that hardly learn."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.world.walkable import standing_room
from elfslam.world.world_file import load_world
from studies.spots import (
    COUNT,
    GUESS,
    MEAN_M,
    RECOGNISED,
    SPACING,
    Point,
    Recipe,
    Repeat,
    measure_repeat,
    measure_spots,
    spots_apart,
)
from studies.study import StudyContext


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


def test_few_spots_are_learnt_for_as_many_steps_as_needed() -> None:
    recipe = Recipe(learnt=40, batch=32, epochs=4, fewest_steps=120)
    assert recipe.epochs_for(8) * (8 * 40 // 32) == 120
    assert recipe.epochs_for(128) == 4
    assert Recipe(learnt=1, batch=32, fewest_steps=5).epochs_for(2) == 5


def test_spots_are_recognised_that_were_learnt() -> None:
    recipe = Recipe(learnt=20, queried=5, batch=20, fewest_steps=40)
    records = measure_repeat(Repeat(Point(COUNT, 2, 1), 0, recipe))
    found = {(each.method, each.metric): each.value for each in records}
    assert found["same visit", RECOGNISED] > 0.8
    assert found["same visit", MEAN_M] < found[GUESS, MEAN_M]


def test_each_point_is_the_mean_of_its_repeats() -> None:
    points = (Point(SPACING, 1.0, 1), Point(COUNT, 2, 2))
    hardly = Recipe(learnt=6, queried=2, batch=6, epochs=1, fewest_steps=1)
    records = measure_spots(StudyContext(), points=points, recipe=hardly)
    guesses = {each.condition: each for each in records if each.method == GUESS}
    assert [each.seeds for each in guesses.values()] == ["0", "0 to 1"]
    assert set(guesses) == {"1 m apart", "2 spots"}
    assert all(0 <= each.value <= 1 for each in records if each.metric == RECOGNISED)
