"""What a study is given, and what it gives: a table, and a page where there is one to look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from elfslam.app.workers import Workers
from elfslam.base.progress import Announce, silent
from elfslam.scoring.page import Page

Row = dict[str, object]


@dataclass(frozen=True)
class Given:
    """The folder of real recordings, and who hears of progress.

    A long study keeps what is finished in the file `kept`, and gives its repeats to `workers`.
    """

    data: Path | None = None
    announce: Announce = silent
    kept: Path | None = None
    workers: Workers | None = None


@dataclass(frozen=True)
class Finding:
    """The rows of a table, and the page that shows what it is about."""

    rows: list[Row]
    page: Page | None = None


Study = Callable[..., list[Row] | Finding]
"""Makes a finding of what is given.

Some take `encoders` by name, too, to be measured in place of the usual ones.
"""


@dataclass(frozen=True)
class LongStudy:
    """A study that goes on from what is kept, and whose repeats others can do."""

    measure: Study
