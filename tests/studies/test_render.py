"""Blocks, figures, the README's table and the tree's page are made of what stands, and no more."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from studies import drawing, render
from studies.drawing import KINDS, RETURNS, Drawing, _runs, _tiles
from studies.mapping import CALIBRATED
from studies.render import differences, figure_text, parse, rendered, table
from studies.results import Record, Result, stamped, write_results
from studies.study import MEDIAN_ALIGNED
from studies.summary import ANSWERED, MEDIAN, METHODS, PLACES, TASKS, TRACK, summary_table
from studies.tree import first_line, tree_page

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
def test_a_figure_is_drawn_for_light_and_dark_and_the_same(results: Path, kind: str) -> None:
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


def planted(*records: Record) -> list[Result]:
    return list(stamped("planted", records, "12345678", "2026-01-01"))


def drawn(kind: str, **how: str) -> Drawing:
    return Drawing("planted", "planted", {}, kind, "caption", "x", **how)


@pytest.mark.parametrize("kind", ["points", "paths"])
def test_two_metrics_of_a_condition_are_a_point(kind: str) -> None:
    results = planted(
        *(Record("truth", metric, value, condition=str(k), world="mall")
          for k, xy in enumerate([(1.0, 2.0), (3.0, 5.0)])
          for metric, value in zip("xy", xy, strict=True))
    )  # fmt: skip
    [axis] = KINDS[kind](results, drawn(kind)).axes
    assert axis.lines[0].get_xydata().tolist() == [[1, 2], [3, 5]]


def test_traces_have_a_strip_each_and_returns_an_upright_in_all() -> None:
    def records() -> Iterator[Record]:
        for name in ("PSD", "ELF"):
            for k in range(4):
                yield Record(name, "ESS", 0.1 * k, condition=str(k))
        yield Record(RETURNS, "ESS", 1.0, condition="3")

    axes = KINDS["traces"](planted(*records()), drawn("traces")).axes
    assert [axis.get_title(loc="left") for axis in axes] == ["PSD", "ELF"]
    assert all(list(axis.lines[0].get_xdata()) == [3, 3] for axis in axes)


def test_a_matrix_is_over_both_numbers_or_over_one_and_the_rows() -> None:
    two = planted(*(Record("a", "dB", k, condition=f"{k} ms, 15.2 kHz") for k in (1, 2)))
    across, up, tiles = _tiles(two, "condition")
    assert (across, up, tiles.tolist()) == ([1, 2], [15.2], [[1, 2]])
    one = planted(*(Record(name, "ELF", 1.0, condition="7") for name in ("first", "second")))
    assert _tiles(one, "method")[:2] == ([7], ["second", "first"])
    assert _runs(np.array([[0, 2, 2, 1]])) == {(0, 1): (2, 2), (0, 3): (1, 1)}
    assert KINDS["matrix"](two, drawn("matrix", rows="condition")).axes


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


def plant(file: Path, text: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


def test_rooms_come_by_floor_and_folders_before_what_lies_in_them(tmp_path: Path) -> None:
    house = tmp_path / "src" / "elfslam"
    plant(house / "app" / "__init__.py", '"""Floor 4: verbs."""\n')
    plant(house / "stages" / "__init__.py", '"""Floor 2: the method."""\n')
    plant(house / "stages" / "echo" / "__init__.py", '"""Echo cutting."""\n')
    plant(house / "stages" / "echo" / "cut.py", '"""Cuts.\n\nMore of it.\n"""\n')
    plant(tmp_path / "studies" / "__init__.py", '"""Tables."""\n')
    page = tree_page(tmp_path)
    places = [
        page.index(text)
        for text in (
            "## src/elfslam/stages/",
            "Floor 2: the method.",
            "| **`echo/`** | Echo cutting. |",
            "| `echo/cut.py` | Cuts. |",
            "## src/elfslam/app/",
            "## studies/",
        )
    ]
    assert places == sorted(places)
    assert "More of it" not in page


def test_a_bar_in_a_first_line_ends_no_cell(tmp_path: Path) -> None:
    plant(tmp_path / "a.py", '"""RUN|MAP."""\n')
    plant(tmp_path / "b.py", "")
    assert first_line(tmp_path / "a.py") == "RUN\\|MAP."
    assert first_line(tmp_path / "b.py") == ""
