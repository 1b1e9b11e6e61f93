"""elfslam show: a page of a run, a map, a world or a saved page, as one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import say
from elfslam.app.show import show_into
from elfslam.cli.options import Force


def show(
    what: Annotated[
        str, typer.Argument(metavar="RUN|MAP|WORLD|PAGE.html", help="What to look at.")
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT.html", help="Where the page goes.")],
    force: Force = False,
) -> None:
    """Make one file of a run, a map, a world or a page with its script, to be sent around."""
    show_into(out, what, overwrite=force)
    say(f"look at {out}")
