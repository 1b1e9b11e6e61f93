"""Studies by name, and their tables on disk."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from elfslam.base.errors import InputError, ParameterError
from elfslam.base.progress import silent
from elfslam.line.feature import SpectralEncoder
from elfslam.scoring.page import Page
from elfslam.world.kinds import QUIET
from studies import catalogue
from studies.catalogue import STUDIES, run_study
from studies.finding import Finding, Given, LongStudy

Row = dict[str, object]
ROWS: list[Row] = [
    {"quantity": "speed", "value": 1.25},
    {"quantity": "size, of steps", "value": None},
]


def test_a_table_is_written_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Path | None] = []

    def study(given: Given) -> list[Row]:
        asked.append(given.data)
        return ROWS

    monkeypatch.setattr(catalogue, "STUDIES", {"gait": study})
    out = tmp_path / "new" / "folder"
    assert run_study("gait", out, tmp_path, silent) == ROWS
    assert asked == [tmp_path]
    assert json.loads((out / "gait.json").read_text()) == ROWS
    with (out / "gait.csv").open(newline="") as stream:
        read = list(csv.DictReader(stream))
    assert read == [
        {"quantity": "speed", "value": "1.25"},
        {"quantity": "size, of steps", "value": ""},
    ]


def test_a_page_is_written_beside_the_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = Page("Walks", "of today", [])
    monkeypatch.setattr(catalogue, "STUDIES", {"gait": lambda given: Finding(ROWS, page)})
    assert run_study("gait", tmp_path, None, silent) == ROWS
    assert "<title>Walks</title>" in (tmp_path / "gait.html").read_text()
    assert (tmp_path / "gait.html").stat().st_size < 500_000
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".csv", ".html", ".js", ".json"]


def test_a_long_study_is_told_where_to_keep_what_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []

    def gait(given: Given) -> list[Row]:
        kept = given.kept
        assert kept is not None
        told.append(kept.read_text() if kept.exists() else "")
        kept.write_text("half")
        if len(told) == 1:
            raise KeyboardInterrupt
        return ROWS

    monkeypatch.setattr(catalogue, "STUDIES", {"gait": LongStudy(gait)})
    with pytest.raises(KeyboardInterrupt):
        run_study("gait", tmp_path, None, silent)
    assert run_study("gait", tmp_path, None, silent) == ROWS
    assert told == ["", "half"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["gait.csv", "gait.json"]


def test_a_long_study_is_given_workers_and_a_short_one_refuses_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []

    def gait(given: Given) -> list[Row]:
        assert given.workers is not None
        counts.append(given.workers.count)
        return ROWS

    monkeypatch.setattr(
        catalogue, "STUDIES", {"gait": LongStudy(gait), "brief": lambda given: ROWS}
    )
    run_study("gait", tmp_path, None, silent)
    run_study("gait", tmp_path, None, silent, on="3")
    assert counts == [1, 3]
    with pytest.raises(InputError, match="study brief: is short and runs in this process"):
        run_study("brief", tmp_path, None, silent, on="2")


def test_encoders_reach_the_studies_that_compare_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[object] = []

    def study(given: Given, encoders: object = "usual") -> list[Row]:
        told.append(encoders)
        return ROWS

    monkeypatch.setattr(catalogue, "STUDIES", {"elf": study, "gait": study})
    mine = {"mine": SpectralEncoder()}
    assert run_study("elf", tmp_path, None, silent) == ROWS
    assert run_study("elf", tmp_path, None, silent, encoders=mine) == ROWS
    assert told == ["usual", mine]
    with pytest.raises(
        InputError, match="study gait: compares no encoders, only displacement, elf"
    ):
        run_study("gait", tmp_path, None, silent, encoders=mine)


def test_an_unknown_study_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"study 'sensor': wanted {', '.join(STUDIES)}; no such"):
        run_study("sensor", tmp_path / "out", None, silent)
    assert not (tmp_path / "out").exists()


def test_only_some_studies_are_of_a_kind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[object] = []

    def study(given: Given, **chosen: object) -> list[Row]:
        told.append(chosen)
        return ROWS

    monkeypatch.setattr(catalogue, "STUDIES", {"gait": study, "mapping": study})
    run_study("mapping", tmp_path, None, silent, kind="quiet")
    run_study("mapping", tmp_path, None, silent)
    assert told == [{"kind": QUIET}, {}]
    with pytest.raises(InputError, match="study gait: is of no kind"):
        run_study("gait", tmp_path, None, silent, kind="quiet")
    with pytest.raises(ParameterError, match="kind 'lazy'"):
        run_study("mapping", tmp_path, None, silent, kind="lazy")


def test_a_column_that_only_some_rows_have_is_empty_in_the_others(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    catalogue._write_csv(file, [{"step": "a", "pairs": 3}, {"step": "b", "map (m)": 0.2}])
    assert file.read_text().splitlines() == ["step,pairs,map (m)", "a,3,", "b,,0.2"]
