"""Text that people send: one line, printable, of bounded length."""

from __future__ import annotations

import unicodedata
from typing import Annotated

from pydantic import AfterValidator, Field

MOST_CHARACTERS = 120
FORBIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories that are not printed, and that databases and terminals stumble over."""


def plain_line(text: str) -> str:
    """The text in Unicode's composed form, without spaces around. Raises ValueError."""
    line = unicodedata.normalize("NFC", text).strip()
    if not line:
        raise ValueError("wanted some text, got none")
    if any(unicodedata.category(character) in FORBIDDEN for character in line):
        raise ValueError("wanted printable characters on one line")
    return line


Line = Annotated[str, Field(max_length=MOST_CHARACTERS), AfterValidator(plain_line)]
"""A field of a request: a name for people."""


def as_line(text: object, otherwise: str) -> str:
    """What can be kept of a text from a file: cut, and without what is not printed."""
    kept = [c for c in str(text) if unicodedata.category(c) not in FORBIDDEN]
    return unicodedata.normalize("NFC", "".join(kept)).strip()[:MOST_CHARACTERS] or otherwise
