"""The README's table, of made-up results."""

import re
from pathlib import Path

from studies.mapping import CALIBRATED
from studies.results import Result, write_results
from studies.study import MEDIAN_ALIGNED
from studies.summary import ANSWERED, MEDIAN, METHODS, PLACES, TASKS, TRACK, summary_table


def result(
    study: str, method: str, metric: str, value: float, condition: str, paper: float | None = None
) -> Result:
    return Result(
        method, metric, value, paper=paper, world="office", scenario="surveyor",
        condition=condition, study=study, commit="0123abcd", date="2026-11-28",
    )  # fmt: skip


MAPPING = [
    result("mapping", "dead reckoning", MEDIAN_ALIGNED, 1.15, CALIBRATED),
    result("mapping", "ELF", MEDIAN_ALIGNED, 0.18, CALIBRATED, 0.63),
    result("mapping", "ELF", MEDIAN_ALIGNED, 9.0, "10 % off"),
    result("mapping", "plain spectrogram", MEDIAN_ALIGNED, 0.2, CALIBRATED),
    result("mapping", "log spectrogram", MEDIAN_ALIGNED, 0.17, CALIBRATED),
]
LOCALIZATION = [
    result("localization", "ELF", MEDIAN, 0.23, "one-shot", 0.54),
    result("localization", "ELF, always answered", MEDIAN, 0.28, "one-shot"),
    result("localization", "log spectrogram, always answered", MEDIAN, 0.29, "one-shot"),
    result("localization", "ELF", MEDIAN, 0.2, "trajectory", 0.41),
    result("localization", "ELF", MEDIAN, 0.19, TRACK),
    result("localization", "ELF", ANSWERED, 0.888, TRACK),
]


def cells(table: str) -> dict[str, list[str]]:
    """By first cell of a row the others."""
    table = re.sub("</?small>", "", table)
    rows = (re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>.*</tr>", table))
    return {row[0]: row[1:] for row in rows if row}


def test_a_cell_has_a_figure_and_a_row_all_methods_by_place(tmp_path: Path) -> None:
    write_results(tmp_path / "mapping.csv", MAPPING)
    write_results(tmp_path / "localization.csv", LOCALIZATION)
    table = summary_table(tmp_path)
    office = slice(len(METHODS), 2 * len(METHODS))
    found = {name: row[office] for name, row in cells(table).items()}
    assert found["mapped, surveyor"] == ["0.17", "<b>0.18</b>", "0.63"]
    assert found["from 0.6 s, surveyor"] == ["0.29", "<b>0.28</b>", "0.54"]
    assert found["walking, surveyor"] == ["-", "<b>0.19</b>", "0.41"]
    assert found["mapped, pedestrians"] == ["-"] * len(METHODS)
    assert cells(table)["dead reckoning, surveyor"] == ["-", "1.15", "-"]
    assert "surveyor: -, 89 %, -." in table
    assert table.count("commit 0123abcd, 2026-11-28") == 2


def test_what_nobody_measured_is_a_dash(tmp_path: Path) -> None:
    found = cells(summary_table(tmp_path))
    assert len(found) == 2 * len(TASKS) + 2
    assert {cell for row in found.values() for cell in row} == {"-"}
    assert {len(row) for row in found.values()} == {len(METHODS) * len(PLACES), len(PLACES)}
