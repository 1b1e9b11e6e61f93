"""The study of walks followed through plans, in small."""

from __future__ import annotations

from pathlib import Path

from elfslam.line.map_matching import MapMatchingParameters
from elfslam.world.kinds import QUIET
from studies.finding import Given
from studies.passages import measure_passages


def test_a_plan_puts_a_walk_right(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    known = MapMatchingParameters(particles=1000)
    small = {"worlds": ("studio",), "seeds": (102,), "rounds": 2, "kind": QUIET, "known": known}
    found = measure_passages(Given(kept=kept), **small)  # type: ignore[arg-type]
    by = {row["walk by"]: row for row in found.rows}
    assert set(by) == {"ELF", "dead reckoning"}
    for row in by.values():
        assert row["followed (m)"] < row["as told (m)"]
        assert 0 <= row["1 sigma"] <= row["2 sigma"] <= 1
    again = measure_passages(Given(kept=kept), **small)  # type: ignore[arg-type]
    assert again.rows == found.rows
    assert len(found.page.panels) == 2
