"""Blocks of pages are made of results alone, and what differs is named."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from studies import drawing, render
from studies.render import differences, figure_text, parse, rendered, table
from studies.results import Record, stamped, write_results

PAGE = """Before.

<!-- results: {told} -->
old
<!-- /results -->
After 0.5.
"""
BY_WORLD = 'metric="error (m)" rows=method columns=world'


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Results of two methods in two worlds, the paper's in one."""
    records = [
        Record("ELF", "error (m)", 0.2, 0.1, 0.312, 0.63, world="office"),
        Record("ELF", "error (m)", 1.25, world="mall"),
        Record("dead reckoning", "error (m)", 12.345, 9.0, 15.0, world="office"),
        Record("ELF", "NEES", 2.0, world="office"),
    ]
    write_results(tmp_path / "walks.csv", stamped("walks", records, "abc", "2026-11-28"))
    for module in (render, drawing):
        monkeypatch.setattr(module, "RESULTS", tmp_path)
    monkeypatch.setattr(render, "FIGURES", tmp_path / "figures")
    return tmp_path


def rows(text: str) -> list[list[str]]:
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_a_table_has_one_figure_a_cell_and_says_where_it_is_from(results: Path) -> None:
    made = table(parse(f"walks {BY_WORLD}"))
    head, _, elf, walked = rows(made)
    assert head == ["method", "office", "mall"]
    assert elf == ["ELF", "0.20 (0.10 to 0.31)", "1.25"]
    assert walked == ["dead reckoning", "12.3 (9 to 15)", "-"]
    assert "`python -m studies walks`, commit abc, 2026-11-28" in made


def test_the_papers_figure_has_a_column_of_its_own(results: Path) -> None:
    head, _, elf, _ = rows(table(parse(f"walks {BY_WORLD} paper=yes interval=no")))
    assert head == ["method", "office", "office, paper", "mall"]
    assert elf == ["ELF", "0.20", "0.63", "1.25"]


def test_rows_come_as_they_are_named(results: Path) -> None:
    made = table(parse(f'walks {BY_WORLD} method="dead*|ELF" world="mall|office"'))
    assert [row[0] for row in rows(made)[2:]] == ["dead reckoning", "ELF"]
    assert rows(made)[0] == ["method", "mall", "office"]


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ('walks metric="speed" rows=method columns=world', "no result fits"),
        ("walks rows=method columns=world", "two results fit"),
        ("walks rows=methods columns=world", "rows=methods"),
        ("walks method", "wanted NAME=VALUE"),
        ("runs rows=method columns=world", "runs.csv"),
    ],
)
def test_a_block_that_cannot_be_made_is_named(results: Path, told: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        rendered(results / "page.md", PAGE.format(told=told))


def test_a_table_of_several_commits_is_refused(results: Path) -> None:
    older = render.read_results(results / "walks.csv")
    write_results(results / "walks.csv", [replace(older[0], commit="older"), *older[1:]])
    with pytest.raises(InputError, match=r"several commits \(older, abc\)"):
        table(parse(f"walks {BY_WORLD}"))


def test_a_page_is_made_anew_once(results: Path) -> None:
    page = results / "page.md"
    page.write_text(PAGE.format(told=f"walks {BY_WORLD}"))
    assert render.render([page]) == ["page.md"]
    text = page.read_text()
    assert text.startswith("Before.")
    assert text.endswith("After 0.5.\n")
    assert "| ELF |" in text
    assert render.render([page]) == []
    assert differences([page]) == []


def test_one_number_altered_in_a_result_is_named(results: Path) -> None:
    page = results / "page.md"
    page.write_text(PAGE.format(told=f"walks {BY_WORLD}"))
    render.render([page])
    known = (results / "walks.csv").read_text()
    (results / "walks.csv").write_text(known.replace("1.25", "1.35"))
    (line,) = differences([page])
    assert "1.25" in line
    assert "1.35" in line
    assert line.startswith("page.md: has '| ELF |")


@pytest.mark.parametrize("kind", ["dots", "curves"])
def test_a_figure_is_drawn_for_light_and_dark_and_is_the_same_again(
    results: Path, kind: str
) -> None:
    curves = [
        Record(name, "error (m)", value, value / 2, value * 2, world="office", condition=at)
        for name, values in {"ELF": (0.1, 0.2), "log spectrogram": (0.3, 0.9)}.items()
        for at, value in zip(("1 person", "2 people"), values, strict=True)
    ]
    write_results(results / "people.csv", stamped("people", curves, "abc", "2026-11-28"))
    page = results / "page.md"
    told = f'errors study=people kind={kind} metric="error (m)" caption="Errors" x="people"'
    page.write_text(f"<!-- figure: {told} -->\n<!-- /figure -->\n")
    assert set(render.render([page])) == {"page.md", "figures/errors.svg"} or kind
    made = (results / "figures" / "errors.svg").read_text()
    assert "prefers-color-scheme:dark" in made
    assert "#030303" not in made
    assert "![Errors](figures/errors.svg)" in page.read_text()
    assert differences([page]) == []
    known = (results / "people.csv").read_text()
    (results / "people.csv").write_text(known.replace("0.9,", "0.8,"))
    assert differences([page]) == ["errors.svg: is of other results"]


def test_figures_to_the_digits_that_matter() -> None:
    values: Sequence[float] = (0.0, 0.0123, 0.1, 0.456, 9.994, 12.34, 123.4, 0.00012, 1234.0)
    texts = ["0", "0.012", "0.10", "0.46", "9.99", "12.3", "123", "0.00012", "1234"]
    assert [figure_text(value) for value in values] == texts
