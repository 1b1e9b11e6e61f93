"""A queue in small: real processes, killed; nothing lost, nothing twice."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.app.workers.processes import Processes
from elfslam.base.errors import InputError
from studies.finding import Given
from studies.queue import measure_queue
from studies.queue_table import Kept, queue_rows


def test_kills_lose_nothing_and_do_nothing_twice(tmp_path: Path) -> None:
    kept = tmp_path / "queue.partial"
    finding = measure_queue(Given(kept=kept), jobs=60, walks=3)
    last = finding.rows[-1]
    assert last["runs"] == 60
    assert (last["lost"], last["done again"], last["unlike"]) == (0, 0, 0)
    assert finding.page is not None
    assert (finding.page.tiles["drivers"], finding.page.tiles["workers killed"]) == ("2", "1")
    assert float(str(last["driver (MiB)"])) > 50
    assert [item.name for item in tmp_path.iterdir() if item.is_dir()] == []


def test_milestones_are_those_of_the_samples() -> None:
    samples = [[1, 1.0, 0, 10.0], [1, 2.0, 3, 20.0], [2, 6.0, 11, 30.0], [2, 9.0, 20, 0.0]]
    rows = queue_rows(Kept(samples), 20, {"lost": 1})
    assert [row["runs"] for row in rows] == [3, 11, 11]
    assert rows[0]["runs/s"] == 1.5
    assert rows[1]["runs/s"] == 2.0
    assert [row["lost"] for row in rows] == [None, None, 1]


def test_the_command_has_its_own_workers(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="leave --on out"):
        measure_queue(Given(kept=tmp_path / "queue.partial", workers=Processes(2)))
