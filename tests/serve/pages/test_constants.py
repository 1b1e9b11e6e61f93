"""What pages and Python share stands in Python, and once in the pages."""

from __future__ import annotations

import re

from tests.serve.pages.constants import FILE, constants

PAGES = FILE.parents[1]
SHARED = ("44100", "2352", "485", "17500", "6300")
"""Numbers that mean the same wherever they stand, alone in an expression."""


def test_the_constants_of_the_pages_are_those_of_python() -> None:
    assert FILE.read_text(encoding="utf-8") == constants()


def test_no_number_of_theirs_stands_twice() -> None:
    found = [
        (file.relative_to(PAGES).as_posix(), number)
        for file in PAGES.rglob("*.js")
        if file != FILE and "vendor" not in file.parts
        for number in re.findall(r"\b\d+\b", code_of(file.read_text(encoding="utf-8")))
        if number in SHARED
    ]
    assert found == []


def code_of(text: str) -> str:
    """A module without comments and strings, its numbers without separators."""
    bare = re.sub(
        r"/\*.*?\*/|//[^\n]*|`(?:\\.|[^`\\])*`|\"(?:\\.|[^\"\\\n])*\"", "", text, flags=re.S
    )
    return re.sub(r"(?<=\d)_(?=\d)", "", bare)
