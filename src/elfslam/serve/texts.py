"""What people send: text of one line, printable, of bounded length; and lists of things."""

import re
import unicodedata
from functools import partial
from typing import Annotated

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field

from elfslam.base.bounds import FARTHEST_M

MOST_CHARACTERS = 120
MOST_FILE_BYTES = 200
"""File systems take names of 255."""
MOST_AT_ONCE = 2_000
"""As many recordings as a user may have."""
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


def _written_as(form: re.Pattern[str], wanted: str, given: object) -> object:
    if isinstance(given, str) and not form.fullmatch(given):
        raise ValueError(f"wanted {wanted}")
    return given


WHOLE = re.compile(r"-?[0-9]{1,20}")
NUMBER = re.compile(r"-?[0-9]{1,20}(\.[0-9]{1,20})?(e-?[0-9]{1,3})?")
AsWhole = BeforeValidator(partial(_written_as, WHOLE, "digits alone, such as 1024"))
AsNumber = BeforeValidator(partial(_written_as, NUMBER, "a decimal number, such as 0.05"))
"""How numbers are written in headers and queries: Python by itself takes " 5" and "5_0", too."""
Line = Annotated[str, Field(max_length=MOST_CHARACTERS), AfterValidator(plain_line)]
"""A field of a request: a name for people."""


def as_line(text: object, otherwise: str) -> str:
    """What can be kept of a text from a file: cut, and without what is not printed."""
    kept = [c for c in str(text) if unicodedata.category(c) not in FORBIDDEN]
    return unicodedata.normalize("NFC", "".join(kept)).strip()[:MOST_CHARACTERS] or otherwise


def as_file_name(text: str) -> str:
    """As much of a text as the name of a file may take on any system, with room for more."""
    return text.encode()[:MOST_FILE_BYTES].decode(errors="ignore")


Id = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
"""A field of a request, as is each of those below."""
Metres = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)]
StartPose = tuple[Metres, Metres, Metres]


class Many(BaseModel):
    """Some things by their ids."""

    ids: list[Id] = Field(min_length=1, max_length=MOST_AT_ONCE)


class Deleted(BaseModel):
    """How many things were there, and are no more."""

    count: int
