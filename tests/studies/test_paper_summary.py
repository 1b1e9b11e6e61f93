"""The summary of the paper's page: its counts by hand, and that it is of the results that stand."""

from pathlib import Path

from studies.paper_summary import (
    ALL,
    CLOSER,
    COMPARED,
    FARTHER,
    OTHER,
    PARTS,
    PARTS_OF,
    WITH_OURS,
    WITHOUT,
    Part,
    measure_paper_summary,
)
from studies.results import RESULTS, ROOT, Record, read_results, stamped, write_results
from studies.study import StudyContext


def test_errors_are_counted_by_side_and_other_numbers_apart(tmp_path: Path) -> None:
    records = [
        Record("ELF", "median error (m)", 0.1, paper=0.2, world="mall", condition="2 people"),
        Record("ELF", "median error (m)", 0.3, paper=0.2, world="mall", condition="4 people"),
        Record("ELF", "recognised", 0.9, paper=0.8, world="mall", condition="6 people"),
        Record("ELF", "median error (m)", 0.1, paper=0.2, world="office", condition="2 people"),
        Record("ELF", "median error (m)", 0.3, world="mall", condition="8 people"),
    ]
    write_results(tmp_path / "a.csv", stamped("a", records, "12345678", "2026-01-01"))
    parts = (
        Part("People", "a", {"world": "mall", "condition": "* people"}),
        Part("Another", "a", {"condition": "nothing"}),
        Part("No file", "b"),
        Part("No study"),
    )
    found = measure_paper_summary(StudyContext(), results=tmp_path, parts=parts)
    whole = {each.metric: each.value for each in found if each.method == ALL}
    assert (whole[PARTS_OF], whole[WITH_OURS], whole[WITHOUT]) == (4, 1, 3)
    assert (whole[COMPARED], whole[CLOSER], whole[FARTHER], whole[OTHER]) == (3, 1, 1, 1)


def test_the_summary_is_of_the_results_that_stand() -> None:
    kept = {(e.method, e.metric): e.value for e in read_results(RESULTS / "paper-summary.csv")}
    now = {(e.method, e.metric): e.value for e in measure_paper_summary(StudyContext())}
    assert kept == now, "run `python -m studies paper-summary`, then render"


def test_the_page_has_every_part() -> None:
    page = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    figures = {part.name.split(":")[0].rstrip("abc") for part in PARTS if ":" in part.name}
    missing = [
        name for name in figures
        if name not in page and name.replace("Figure ", "") not in page
    ]  # fmt: skip
    assert not missing
