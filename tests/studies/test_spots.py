"""The measurement study in miniature: a few spots, classifiers that hardly learn."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.world.walkable import standing_room
from elfslam.world.world_file import load_world
from studies import spots
from studies.finding import Finding, Given
from studies.repeats import Numbers
from studies.spots import (
    COUNT,
    POINTS,
    SPACING,
    Point,
    Recipe,
    Repeat,
    measure_repeat,
    measure_spots,
    spots_apart,
    spots_of,
)

FEW = (Point(SPACING, 1.0, 1), Point(COUNT, 2, 2))
HARDLY = Recipe(learnt=6, asked=2, batch=6, epochs=1, fewest_steps=1)


def run(kept: Path) -> Finding:
    return measure_spots(Given(kept=kept), points=FEW, recipe=HARDLY, stable_spots=3)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("spots") / "kept"


@pytest.fixture(scope="module")
def finding(kept: Path) -> Finding:
    return run(kept)


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


def test_marked_spots_are_drawn_once_each() -> None:
    world = load_world("lab")
    found = spots_of(Point(COUNT, 128, 1), world, np.random.default_rng(0))
    assert len(np.unique(found, axis=0)) == 128
    assert len(spots_of(Point(SPACING, 2.0, 1), world, np.random.default_rng(0))) == 16


def test_few_spots_are_learnt_for_as_many_steps_as_needed() -> None:
    recipe = Recipe(learnt=40, batch=32, epochs=4, fewest_steps=120)
    assert recipe.epochs_for(8) * (8 * 40 // 32) == 120
    assert recipe.epochs_for(128) == 4
    assert Recipe(learnt=1, batch=32, fewest_steps=5).epochs_for(2) == 5


def test_spots_are_recognised_that_were_learnt() -> None:
    recipe = Recipe(learnt=20, asked=5, batch=20, fewest_steps=40)
    found = measure_repeat(Repeat(Point(COUNT, 2, 1), 0, recipe))
    assert found["recognised, same visit"] > 0.8
    assert found["error (m), same visit"] < found["error (m), a guess"]
    assert found["nearest spot (m)"] == pytest.approx(2 * found["error (m), a guess"])


def test_every_point_has_a_row_of_each_measure(finding: Finding) -> None:
    named = [row for row in finding.rows if str(row["over"]).endswith("repeats")]
    assert len(named) == 6 * len(FEW)
    assert {(row["varied"], row["at"], row["over"]) for row in named} == {
        (SPACING, 1.0, "1 repeats"),
        (COUNT, 2, "2 repeats"),
    }
    spacing = [row["mean"] for row in named if row["measure"] == "nearest spot (m)"]
    assert spacing[0] == pytest.approx(1.0, abs=0.2)
    assert all(0 <= r["mean"] <= 1 for r in named if "recognised" in str(r["measure"]))  # type: ignore[operator]


def test_the_page_shows_tables_and_curves(finding: Finding) -> None:
    assert finding.page is not None
    titles = [panel.title for panel in finding.page.panels]
    assert titles[:5] == [
        "Spots told apart",
        "Spots recognised against spacing",
        "Mean error against spacing",
        "Spots recognised against spots",
        "Mean error against spots",
    ]
    assert len(titles) == 11
    assert list(finding.page.details) == ["Table of the spectra"]


def test_finished_repeats_are_not_measured_again(
    finding: Finding, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(json.loads(kept.read_text())) == 3

    @functools.wraps(spots.measure_repeat)
    def refuse(repeat: Repeat) -> Numbers:
        raise AssertionError(f"measured again: {repeat}")

    monkeypatch.setattr(spots, "measure_repeat", refuse)
    assert run(kept).rows == finding.rows


def test_the_full_study_has_the_points_of_the_paper() -> None:
    spacings, counts = ([p.at for p in POINTS if p.varied == v] for v in (SPACING, COUNT))
    assert spacings == [0.25, 0.5, 1.0, 2.0, 3.0]
    assert counts == [8, 16, 32, 64, 128]
