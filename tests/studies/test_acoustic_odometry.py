"""The study of acoustic odometry in small: sound mends the scale of a walk."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.world.kinds import QUIET
from studies import walls_in_focus
from studies.acoustic_odometry import (
    SCALE_COLUMNS,
    WALKS,
    _row,
    measure_acoustic_odometry,
)
from studies.finding import Finding, Given
from studies.repeats import Numbers
from studies.simulated_walk import SimulatedWalk


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Finding:
    kept: Path = tmp_path_factory.mktemp("acoustic") / "kept.partial"
    walks = [SimulatedWalk("studio", 100, 2), SimulatedWalk("lounge", 105, 2)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(walls_in_focus, "SHOWN_ROUNDS", 2)
        finding = measure_acoustic_odometry(Given(kept=kept), walks=walks, kind=QUIET)
    assert kept.exists()
    return finding


def test_sound_mends_the_scale_of_a_walk(found: Finding) -> None:
    studio, lounge, both = found.rows
    assert [row["world"] for row in found.rows] == ["studio", "lounge", "all"]
    for row in found.rows:
        claimed, measured = (float(str(row[SCALE_COLUMNS[k]])) for k in (2, 3))
        assert claimed > 3.0, "these walkers' steps are not the usual ones"
        assert measured < 0.8 * claimed
        assert row["refused"] == 0
    assert (studio["maps"], lounge["maps"], both["maps"]) == (1, 1, 2)
    assert float(str(studio["measured over claimed"])) < 1.0


def test_the_page_shows_walls_scales_and_tables(found: Finding) -> None:
    assert found.page is not None
    titles = [panel.title for panel in found.page.panels]
    assert titles == [
        "Walls in and out of focus", "Sharpness of the walls at every scale",
        "Measured against true", "What two frames alone tell", "Scale of the walks", "Maps",
    ]  # fmt: skip


def walk(true: float, scale: float, sigma: float, used: float) -> Numbers:
    errors_m = {"claimed": 0.4, "measured": 0.1 * used, "true": 0.1}
    maps = {f"map error, {name}": error_m for name, error_m in errors_m.items()}
    return {"true": true, "scale": scale, "sigma": sigma, "used": used} | maps


def test_a_row_counts_refused_walks_but_not_in_the_normalised_error() -> None:
    walks = [walk(0.8, 0.82, 0.01, 0.8), walk(1.25, 1.0, float("inf"), 1.0)]
    row = _row("here", walks)
    assert row["refused"] == 1
    assert row["normalised error squared"] == pytest.approx(4.0)
    assert row[SCALE_COLUMNS[2]] == pytest.approx(100 * ((0.25**2 + 0.2**2) / 2) ** 0.5)
    assert row[SCALE_COLUMNS[3]] == pytest.approx(100 * (0.2**2 / 2) ** 0.5)
    assert row["improved"] == 0.5
    assert (row["improved, from"], row["improved, to"]) == (0.0, 1.0)
    assert row["measured over claimed"] == pytest.approx(0.225)


def test_walks_that_are_all_refused_have_no_normalised_error() -> None:
    row = _row("here", [walk(0.9, 1.0, float("inf"), 1.0)])
    assert row["refused"] == 1
    assert row["normalised error squared"] is None


def test_evaluation_has_ten_walks_in_every_world() -> None:
    seeds = {world: [each.seed for each in WALKS if each.world == world] for world in
             ("studio", "lounge", "concourse", "living_room", "office", "mall")}  # fmt: skip
    assert all(len(some) == 10 for some in seeds.values())
    assert min(seeds["studio"] + seeds["lounge"] + seeds["concourse"]) >= 110
