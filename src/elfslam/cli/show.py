"""elfslam show: a page of a run, a map or a world."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import say
from elfslam.app.show import drawing_of
from elfslam.data.folders import new_file


def show(
    what: Annotated[str, typer.Argument(metavar="RUN|MAP|WORLD", help="What to look at.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.html", help="Where the page goes.")],
    self_contained: Annotated[
        bool, typer.Option("--self-contained", help="One file, 5 MB, that can be sent around.")
    ] = False,
) -> None:
    """Draw a run, a map or a world as a page."""
    draw = drawing_of(what)
    with new_file(out) as page:
        draw(page, self_contained=self_contained)
    say(f"look at {out}")
