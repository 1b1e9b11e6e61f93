"""Texts use the field's words: what must not come back, and where an engineer's grep lands.

Searched are the pages, and the docstrings and comments of the package; `code` in them is let pass.
"""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "elfslam"
MADE = ROOT / "docs" / "reference" / "tree.md"
PAGES = [ROOT / "README.md", *sorted({*(ROOT / "docs").rglob("*.md")} - {MADE})]
OURS = {
    r"rivals?": "baseline; of a closure: competing candidate",
    r"strangers?": "query, query walk",
    r"(who(ever)?|somebody|those who) asks?": "query, query walk",
    r"likeness(es)?": "similarity, score",
    r"resembl(e|es|ed|ance)": "is similar to",
    r"(how|more|most|less|as|so|equally) alike": "similarity; more, most similar",
    r"guesses": "particles; of an optimiser: initial guess",
    r"ordinary life|(quiet|ordinary) days?": "realistic, controlled scenario",
    r"senses?": "modality",
    r"echoes of nothing": "a zero prior",
    r"(of|through|in|into|along|by|to|on) the (same )?line": "the pipeline",
    r"the line('s| put together)": "the pipeline",
    r"(off|beside) the line|mapped line": "off, beside the mapped path",
}
"""What was said once, and what to say."""
ONLY_IN_PAGES = {r"heard|hears?": "recorded, measured, detected, extracted"}
ALLOWED = {
    ("src/elfslam/world/", "of the line"): "a straight line in plan",
    ("src/elfslam/world/", "in the line"): "a power line",
    ("src/elfslam/world/", "on the line"): "a power line",
    ("src/elfslam/data/", "of the line"): "a straight line; a line of a text file",
    ("src/elfslam/serve/", "who asks"): "whoever sends a request",
    ("src/elfslam/serve/", "whoever asks"): "whoever sends a request",
    ("docs/how-to/known_truth.md", "hear"): "people and dogs do",
    ("docs/how-to/known_truth.md", "heard"): "people who speak are",
    ("docs/how-to/what_to_expect.md", "hear"): "people and dogs do",
}
"""By the beginning of a path and phrase: what it means there."""
SKIPPED = re.compile(r"^(```|~~~).*?^\1|`[^`\n]*`|<!--.*?-->|\]\([^)]*\)", re.S | re.M)
"""Code, comments of pages, and where links lead."""
LANDS = {
    "^particle filter": "track",
    "map matching": "map_matching",
    "pose graph": "graph",
    "outlier rejection": "graph",
    "marginal covariance": "graph",
    "loop closure detection": "closure",
    "step detection": "motion",
    "pedestrian dead reckoning": "motion",
    "matched filter": "echo",
    "feature mean normalisation": "feature",
    "replay and spoofing detection": "spoofing",
    "acoustic odometry": "acoustic_odometry",
}
"""The one stage, a file or folder, whose first lines have a term."""


@cache
def modules() -> list[tuple[Path, ast.Module]]:
    files = [file for file in sorted(PACKAGE.rglob("*.py")) if "vendor" not in file.parts]
    return [(file, ast.parse(file.read_text(encoding="utf-8"))) for file in files]


def said_in(source: str, tree: ast.Module) -> str:
    """The docstrings of a module and what it holds, strings after fields, and comments."""
    strings = (
        node.value.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    comments = (token.string for token in tokens if token.type == tokenize.COMMENT)
    return "\n\n".join([*strings, *comments])


def found(text: str, phrases: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Each phrase of ours in a text, and what to say for it."""
    plain = re.sub(r"\s+", " ", SKIPPED.sub(" ", text))
    for phrase, instead in phrases.items():
        for match in re.finditer(rf"\b(?:{phrase})(?!\w)", plain, re.I):
            yield match[0].lower(), instead


def offences(file: Path, text: str, phrases: dict[str, str]) -> list[str]:
    name = file.relative_to(ROOT).as_posix()
    allowed = {phrase for start, phrase in ALLOWED if name.startswith(start)}
    wrong = ((bad, good) for bad, good in found(text, phrases) if bad not in allowed)
    return [f"{name}: {bad!r}; say: {good}" for bad, good in wrong]


def test_pages_use_the_words_of_the_field() -> None:
    said = [(page, page.read_text(encoding="utf-8")) for page in PAGES]
    phrases = OURS | ONLY_IN_PAGES
    assert [each for page, text in said for each in offences(page, text, phrases)] == []


def test_docstrings_and_comments_use_the_words_of_the_field() -> None:
    said = [(file, said_in(file.read_text(encoding="utf-8"), tree)) for file, tree in modules()]
    assert [each for file, text in said for each in offences(file, text, OURS)] == []


def test_an_engineer_s_grep_lands_in_one_stage() -> None:
    stages = PACKAGE / "stages"
    first = [
        (file.relative_to(stages).parts[0].removesuffix(".py"), (said or "").partition("\n")[0])
        for file, tree in modules()
        if file.is_relative_to(stages)
        for said in [ast.get_docstring(tree)]
    ]
    lands = {term: {at for at, line in first if re.search(term, line, re.I)} for term in LANDS}
    assert lands == {term: {stage} for term, stage in LANDS.items()}


@pytest.mark.parametrize(
    ("text", "phrases"),
    [
        ("A rival of the\nline", ["rival", "of the line"]),
        ("How alike two are, to who asks", ["who asks", "how alike"]),
        ("`rival`, rival_margin, arrivals, [maps](rival.md), in a line", []),
    ],
)
def test_phrases_are_noticed(text: str, phrases: list[str]) -> None:
    assert [phrase for phrase, _ in found(text, OURS)] == phrases


def test_docstrings_and_comments_are_read() -> None:
    source = '"""One."""\n\nA = 1  # two\n"""Three."""\nB = "four"\n'
    assert said_in(source, ast.parse(source)) == "One.\n\nThree.\n\n# two"
