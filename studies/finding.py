"""What a study gives: a table, and a page where there is something to look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from elfslam.scoring.page import Page

Row = dict[str, object]


@dataclass(frozen=True)
class Finding:
    """The rows of a table, and the page that shows what it is about."""

    rows: list[Row]
    page: Page | None = None


Study = Callable[..., list[Row] | Finding]
"""Makes a finding, given the folder of real recordings (or None) and who hears of progress.

Some take `encoders` by name, too, to be measured in place of the usual ones.
"""


@dataclass(frozen=True)
class LongStudy:
    """A study that keeps what is finished in the file it is given, and goes on from there.

    It gives its repeats to `workers`, a keyword.
    """

    measure: Callable[..., list[Row] | Finding]
