"""The documentation: links lead somewhere, commands exist, its pages of tables can be made."""

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from docs import hooks
from elfslam.app.settings import Settings
from elfslam.base.parameters import rows
from elfslam.cli.app import VERBS, command_of
from studies import render
from studies.catalogue import STUDIES
from studies.tree import PAGE, ROOT, tree_page

PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md",
         *sorted({*(ROOT / "docs").rglob("*.md")} - {PAGE})]  # fmt: skip
HISTORY = {ROOT / "CHANGELOG.md", *(ROOT / "docs" / "log").glob("*.md")}
"""Name what is gone."""
PRESENT = sorted({*PAGES} - HISTORY)
INSIDE = ("", "stages", "serve", "serve/pages", "serve/pages/stages")
PLACES = [ROOT, *(ROOT / "src" / "elfslam" / folder for folder in INSIDE)]
"""What the paths of files in the pages are relative to."""
MOST_README_WORDS = 1100
"""Rendered blocks left out."""
README_DECIMALS = {"0.6", "3.11"}
"""Seconds of sound, and Python's version."""
FENCE = re.compile(r"^(```|~~~).*?^\1", re.S | re.M)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
COMMAND = re.compile(r"(?<![\w./-])elfslam ([a-z][a-z-]*)(?![\w.])")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
FILE = re.compile(r"(?:\w+/)+\w+(?:\.\w+)*\.(?:py|js|mjs|toml|ipynb)")
PARAMETER = re.compile(r"[a-z_]+\.[a-z][a-z0-9_]*")
SUFFIXES = ("csv", "js", "json", "py")
ACTIONS = ("all", "render")
STUDY = re.compile(r"python -m studies ([a-z][a-z-]*)")
MODULE = re.compile(r"python -m ((?:studies|elfslam)(?:\.[a-z_]+)+)\b(?!\.)")


def page_name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def prose(page: Path) -> str:
    """A page without its blocks of code, in which brackets are no links."""
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """What can be linked to in a page: its headings, written as MkDocs and forges write them."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.M)
    return {anchor_of(re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)) for heading in headings}


def anchor_of(heading: str) -> str:
    return re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", heading.lower()).strip())


def dead_links(page: Path) -> Iterator[str]:
    for link in LINK.findall(re.sub(r"`[^`]*`", "", prose(page))):
        target, _, anchor = link.partition("#")
        if "://" in link or link.startswith("mailto:"):
            continue
        file = (page.parent / target).resolve() if target else page
        if not file.exists() or (anchor and anchor not in anchors(file)):
            yield link


def code_lines(text: str) -> list[str]:
    """Lines of code: each of a block, without its comment, and each stretch in a sentence."""
    blocks = "\n".join(match[0] for match in FENCE.finditer(text)).splitlines()
    indented = re.findall(r"^    (\S.*)$", text, re.M)
    stretches = re.findall(r"`([^`\n]+)`", FENCE.sub("", text))
    return [line.partition(" #")[0] for line in [*blocks, *indented]] + stretches


def unknown_commands(text: str) -> Iterator[str]:
    for line in code_lines(text):
        for verb in COMMAND.findall(line):
            yield from [f"elfslam {verb}"] if verb not in VERBS else unknown_options(verb, line)
    named = {*STUDIES, *ACTIONS}
    yield from (f"studies {name}" for name in STUDY.findall(text) if name not in named)
    yield from (module for module in MODULE.findall(text) if not is_module(module))


def unknown_options(verb: str, line: str) -> Iterator[str]:
    named = {name for at in command_of(verb).params for name in (*at.opts, *at.secondary_opts)}
    words = line[line.index(f"elfslam {verb}") :]
    named |= {"--help"}
    yield from (f"{verb} {name}" for name in OPTION.findall(words) if name not in named)


def unknown_parameters(text: str) -> Iterator[str]:
    names = {row.name for row in rows(Settings())}
    groups = {name.partition(".")[0] for name in names}
    for line in code_lines(text):
        for name in {line.partition("=")[0], *re.findall(r"--set ([^= ]+)=", line)}:
            group, _, last = name.partition(".")
            if PARAMETER.fullmatch(name) and group in groups and last not in SUFFIXES:
                yield from [name] if name not in names else []


def missing_files(text: str) -> Iterator[str]:
    for line in code_lines(text):
        if FILE.fullmatch(line) and not any((place / line).exists() for place in PLACES):
            yield line


def unknown_imports(text: str) -> Iterator[str]:
    for block in re.findall(r"^```python\n(.*?)^```", text, re.S | re.M):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module:
                module = import_module(node.module)
                names = (alias.name for alias in node.names)
                yield from (f"{node.module}.{name}" for name in names if not hasattr(module, name))


def is_module(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_links_lead_somewhere(page: Path) -> None:
    assert list(dead_links(page)) == []


@pytest.mark.parametrize("page", PRESENT, ids=page_name)
def test_examples_in_python_import_what_is_there(page: Path) -> None:
    assert list(unknown_imports(page.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize("page", PRESENT, ids=page_name)
def test_commands_parameters_and_files_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert [*unknown_commands(text), *unknown_parameters(text), *missing_files(text)] == []


def test_tables_are_of_the_results_that_stand() -> None:
    texts = {page: page.read_text(encoding="utf-8") for page in render.PAGES}
    stale = [page for page, text in texts.items() if render.rendered(page, text) != text]
    assert stale == [], "what differs: python -m studies render, git diff"


@pytest.mark.real
def test_drawings_are_of_the_results_that_stand() -> None:
    assert render.differences() == []


def test_every_verb_is_told_of() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert [verb for verb in VERBS if f"elfslam {verb}" not in text] == []


def test_every_study_is_told_of() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in PRESENT)
    told = {*STUDY.findall(text)}
    assert sorted(set(STUDIES) - told) == []


def test_the_tree_of_files_names_commands_that_exist_and_is_not_committed() -> None:
    assert list(unknown_commands(tree_page(ROOT))) == []
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").split()
    assert f"/{page_name(PAGE)}" in ignored


def test_every_page_is_in_the_navigation() -> None:
    named = set(re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8")))
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    assert named == pages | {PAGE.relative_to(ROOT / "docs").as_posix()}


def test_the_code_names_pages_that_are_there() -> None:
    files = [file for room in ("src/elfslam", "studies") for file in (ROOT / room).rglob("*.py")]
    texts = [file.read_text(encoding="utf-8") for file in files]
    named = {page for text in texts for page in re.findall(r"docs/[\w/-]+\.md", text)}
    assert [page for page in sorted(named) if not (ROOT / page).exists()] == []


def test_the_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    text = re.sub(r"<!-- (summary|figure|results).*?<!-- /\1 -->", "", text, flags=re.S)
    assert len(text.split()) <= MOST_README_WORDS


def test_the_readme_has_no_typed_result() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    text = re.sub(r"<!-- (summary|figure|results).*?<!-- /\1 -->", "", text, flags=re.S)
    text = FENCE.sub("", text)
    assert set(re.findall(r"\d+\.\d+", text)) <= README_DECIMALS


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("`elfslam fly`", ["elfslam fly"]),
        ("```\nelfslam map WALK RUN\nelfslam study x OUT\n```", ["elfslam study"]),
        ("    elfslam map WALK RUN --colour red  # --size", ["map --colour"]),
        ("`python -m studies no-such OUT`", ["studies no-such"]),
        ("`python -m studies.benchmarks.nothing`", ["studies.benchmarks.nothing"]),
        ("`python -m studies mapping OUT`, `elfslam map A B`, the folder elfslam lies in", []),
    ],
)
def test_the_gate_notices_commands(text: str, found: list[str]) -> None:
    assert list(unknown_commands(text)) == found


REFERENCE = ROOT / "docs" / "reference"


def test_every_verb_has_a_section() -> None:
    page = hooks.on_page_markdown((REFERENCE / "commands.md").read_text())
    assert [verb for verb in VERBS if f"\n## {verb}\n" not in page] == []
    assert hooks.COMMANDS not in page


def test_a_verb_tells_arguments_options_and_defaults() -> None:
    section = hooks.command_section("locate")
    assert "elfslam locate RECORDING MAP OUT.csv [OPTIONS]" in section
    assert "| `--seed` | Of the tracker's draws. Default: `0`. |" in section
    assert "Default: ``" not in section


def test_parameters_stand_by_group_with_value_and_unit() -> None:
    page = hooks.on_page_markdown((REFERENCE / "parameters.md").read_text())
    chirp = page.partition("\n## chirp\n")[2].partition("\n## ")[0]
    assert "| `band_low_hz` | 15000.0 | Hz | lower end of the band |" in chirp
    assert hooks.PARAMETERS not in page


def test_studies_stand_with_their_question_and_minutes() -> None:
    assert hooks.STUDY_TABLE in (ROOT / "docs" / "how-to" / "studies.md").read_text()
    table = hooks.study_table(["mapping"])
    assert len(table.splitlines()) == 3
    assert "| `mapping` | How far off are maps, by method, in the paper's three places? | " in table


@pytest.mark.parametrize("text", ["", "# A page\n\nwithout markers"])
def test_other_pages_stay(text: str) -> None:
    assert hooks.on_page_markdown(text) == text
