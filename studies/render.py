"""Tables and figures of README and docs, made of `results/` alone.

A block in a page names what it shows, and holds it:

    <!-- results: mapping scenario=surveyor metric="precision" rows=method columns=world -->
    ...
    <!-- /results -->

`rows` and `columns` are columns of the CSV, several by commas; `NAME=VALUE` takes the rows of these
values ("a|b"), in this order (`value*` takes what begins so). A cell has a figure and its interval;
`interval=no` leaves that out, and `paper=yes` puts the paper's figure in a column beside ours.
A figure is drawn into `docs/figures/NAME.svg`, of the rows that it names likewise:

    <!-- figure: NAME study=mapping kind=dots metric="precision" caption="..." x="precision" -->
    <!-- /figure -->

The README's table of the main results stands in a block of its own, `<!-- summary -->`.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from elfslam.base.errors import InputError
from elfslam.data.atomic_files import replaced_file
from studies.reached import ROOT
from studies.results import COLUMNS, RESULTS, Result, read_results

if TYPE_CHECKING:
    from studies.drawing import Drawing

BLOCK = re.compile(r"(<!-- (results|figure): (.+?) -->\n).*?(<!-- /\2 -->)", re.S)
SUMMARY = re.compile(r"(<!-- summary -->).*?(<!-- /summary -->)", re.S)
FIGURES = ROOT / "docs" / "figures"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
OPTIONS = ("rows", "columns", "interval", "paper")
FIGURE_OPTIONS = ("study", "kind", "caption", "x", "y", "rows", "panels", "logarithmic")
PAPER = "paper"
DASH = "-"


@dataclass(frozen=True)
class Shown:
    """What a block shows of a result file."""

    name: str
    where: Mapping[str, tuple[str, ...]]
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    interval: bool = True
    paper: bool = False


def rendered(page: Path, text: str) -> str:
    """The text of a page with its blocks made anew. Raises InputError for one that cannot be."""

    def block(found: re.Match[str]) -> str:
        opening, kind, told, closing = found.groups()
        try:
            content = table(parse(told)) if kind == "results" else shown_in(page, drawing_of(told))
        except InputError as refused:
            raise InputError(f"{_name(page)}: block {told!r}: {refused}") from refused
        return f"{opening}{content}\n{closing}"

    made = BLOCK.sub(block, text)
    return SUMMARY.sub(lambda found: f"{found[1]}\n{_summary()}\n{found[2]}", made)


def render(pages: Iterable[Path] = PAGES) -> list[str]:
    """Make all blocks and figures anew; the files that changed, from the root of the project."""
    made = all_made(pages)
    changed = [file for file, text in made.items() if not _is(file, text)]
    for file in changed:
        file.parent.mkdir(parents=True, exist_ok=True)
        with replaced_file(file) as partial:
            partial.write_text(made[file], encoding="utf-8")
    return [_name(file) for file in changed]


def differences(pages: Iterable[Path] = PAGES) -> list[str]:
    """What `render` would change: a line for each figure of a table, and for each drawing."""
    found = []
    for file, text in all_made(pages).items():
        if file.suffix == ".svg":
            found += [] if _is(file, text) else [f"{_name(file)}: is of other results"]
            continue
        pairs = zip_longest(file.read_text(encoding="utf-8").splitlines(), text.splitlines())
        found += [f"{_name(file)}: has {old!r}, wanted {new!r}" for old, new in pairs if old != new]
    return found


def all_made(pages: Iterable[Path]) -> dict[Path, str]:
    """The text of every page, and of every figure that one shows.

    Raises InputError where a block cannot be made, or two figures share a name.
    """
    from studies.drawing import svg

    texts = {page: page.read_text(encoding="utf-8") for page in pages}
    drawings: dict[str, Drawing] = {}
    for text in texts.values():
        for _, kind, told, _ in BLOCK.findall(text):
            if kind == "figure":
                drawing = drawing_of(told)
                if drawings.setdefault(drawing.name, drawing) != drawing:
                    raise InputError(f"figure {drawing.name}: drawn in two ways; rename one")
    made = {page: rendered(page, text) for page, text in texts.items()}
    return made | {_file_of(name): svg(drawing) for name, drawing in drawings.items()}


def _summary() -> str:
    from studies.summary import summary_table

    return summary_table()


def parse(told: str) -> Shown:
    """What a block of results says. Raises InputError for words that it does not know."""
    name, where, given = _words(told, OPTIONS)
    rows, columns = (tuple(given.get(key, "").split(",")) for key in ("rows", "columns"))
    if not {*rows, *columns} <= set(COLUMNS):
        raise InputError(f"rows={','.join(rows)} columns={','.join(columns)}: wanted {COLUMNS}")
    interval, paper = given.get("interval") != "no", given.get(PAPER) == "yes"
    return Shown(name, where, rows, columns, interval, paper)


def drawing_of(told: str) -> Drawing:
    """What a block of a figure says. Raises InputError for words that it does not know."""
    from studies.drawing import Drawing

    name, where, given = _words(told, FIGURE_OPTIONS)
    missing = [each for each in ("study", "kind", "caption", "x") if each not in given]
    if missing:
        raise InputError(f"wanted {', '.join(missing)} as well")
    rows, panels = given.get("rows", "method"), given.get("panels", "world")
    return Drawing(
        name, given["study"], where, given["kind"], given["caption"], given["x"],
        given.get("y", ""), rows, panels, given.get("logarithmic") == "yes",
    )  # fmt: skip


def _words(
    told: str, options: Sequence[str]
) -> tuple[str, dict[str, tuple[str, ...]], dict[str, str]]:
    """Name, wanted values by column, and options of a block."""
    name, *rest = shlex.split(told)
    where: dict[str, tuple[str, ...]] = {}
    given: dict[str, str] = {}
    for each in rest:
        key, equals, value = each.partition("=")
        if not equals or key not in (*COLUMNS, *options):
            wanted = ", ".join((*COLUMNS, *options))
            raise InputError(f"{each}: wanted NAME=VALUE, NAME one of {wanted}")
        if key in options:
            given[key] = value
        else:
            where[key] = tuple(value.split("|"))
    return name, where, given


def table(shown: Shown) -> str:
    """A Markdown table of results, one figure a cell, and a line that says what it was made of.

    Raises InputError where no result fits, or two fit one cell, or they are of several commits.
    """
    chosen = select(read_results(RESULTS / f"{shown.name}.csv"), shown.where)
    if not chosen:
        raise InputError("no result fits; look into the CSV for what there is")
    cells = _cells(chosen, shown)
    rows = _ordered((row for row, _ in cells), shown.rows, shown.where)
    columns = _ordered((column for _, column in cells), shown.columns, shown.where)
    if shown.paper:
        columns = [each for column in columns for each in (column, (*column, PAPER))]
        columns = [each for each in columns if any((row, each) in cells for row in rows)]
        columns = list(dict.fromkeys(columns))
    head = [*(name for name in shown.rows), *(_label(", ".join(column)) for column in columns)]
    lines = [_line(head), _line(["---"] * len(shown.rows) + ["---:"] * len(columns))]
    lines += [
        _line([*map(_label, row), *(cells.get((row, column), DASH) for column in columns)])
        for row in rows
    ]
    return "\n".join([*lines, "", f"<sub>{provenance(chosen)}</sub>"])


def select(results: Sequence[Result], where: Mapping[str, tuple[str, ...]]) -> list[Result]:
    """The results whose columns have the wanted values, in the order in which these are named."""
    for name, wanted in reversed(list(where.items())):
        ranked = [(_rank(getattr(each, name), wanted), each) for each in results]
        known = [(rank, each) for rank, each in ranked if rank is not None]
        results = [each for _, each in sorted(known, key=lambda pair: pair[0])]
    return list(results)


def provenance(results: Sequence[Result]) -> str:
    """Which study made the results, at what commit, with what encoder, when, on which seeds.

    Raises InputError where they are of several commits: such a table compares what cannot be.
    """
    commits = list(dict.fromkeys(each.commit for each in results))
    if len(commits) > 1:
        raise InputError(f"rows of several commits ({', '.join(commits)}); run the study again")
    first = results[0]
    seeds = "; ".join(dict.fromkeys(each.seeds for each in results if each.seeds))
    parts = [f"`python -m studies {first.study}`", f"commit {first.commit}", first.date]
    parts += [f"encoder {first.encoder}"] if first.encoder else []
    return ", ".join(parts + ([f"seeds {seeds}"] if seeds else []))


def shown_in(page: Path, drawing: Drawing) -> str:
    """The line that shows a figure in a page, and one that says what it was made of."""
    file = os.path.relpath(_file_of(drawing.name), page.parent)
    chosen = select(read_results(RESULTS / f"{drawing.study}.csv"), drawing.where)
    image = f"![{drawing.caption}]({Path(file).as_posix()})"
    return f"{image}\n\n<sub>{provenance(chosen)}</sub>" if chosen else image


def figure_text(value: float) -> str:
    """A figure to the digits that can matter: three, and no more than two behind the point."""
    if value == round(value):
        return f"{value:.0f}"
    if abs(value) < 0.1:
        return f"{value:.3f}".rstrip("0") if abs(value) >= 0.001 else f"{value:.2g}"
    return (
        f"{value:.2f}"
        if abs(value) < 10
        else f"{value:.1f}"
        if abs(value) < 100
        else f"{value:.0f}"
    )


def _cells(results: Sequence[Result], shown: Shown) -> dict[tuple[tuple[str, ...], ...], str]:
    cells: dict[tuple[tuple[str, ...], ...], str] = {}
    for each in results:
        row, column = (tuple(str(getattr(each, name)) for name in names)
                       for names in (shown.rows, shown.columns))  # fmt: skip
        if (row, column) in cells:
            raise InputError(f"{row} and {column}: two results fit; say more of what is wanted")
        cells[row, column] = _cell(each, shown)
        if shown.paper and each.paper is not None:
            cells[row, (*column, PAPER)] = figure_text(each.paper)
    return cells


def _cell(result: Result, shown: Shown) -> str:
    text = figure_text(result.value)
    if result.low is None or result.high is None or not shown.interval:
        return text
    return f"{text} ({figure_text(result.low)} to {figure_text(result.high)})"


def _ordered(
    keys: Iterable[tuple[str, ...]], names: Sequence[str], where: Mapping[str, tuple[str, ...]]
) -> list[tuple[str, ...]]:
    """Each key once, as its columns' values were named, and as it came where none was."""

    def rank(key: tuple[str, ...]) -> list[int]:
        ranks = (_rank(value, where.get(name, ())) for name, value in zip(names, key, strict=False))
        return [0 if each is None else each for each in ranks]

    return sorted(dict.fromkeys(keys), key=rank)


def _rank(value: str, wanted: Sequence[str]) -> int | None:
    for rank, each in enumerate(wanted):
        if value == each or (each.endswith("*") and value.startswith(each[:-1])):
            return rank
    return None


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _label(text: str) -> str:
    return text.replace("_", " ").strip(" ,")


def _file_of(name: str) -> Path:
    return FIGURES / f"{name}.svg"


def _name(file: Path) -> str:
    return file.relative_to(ROOT).as_posix() if file.is_relative_to(ROOT) else file.name


def _is(file: Path, text: str) -> bool:
    return file.exists() and file.read_text(encoding="utf-8") == text
