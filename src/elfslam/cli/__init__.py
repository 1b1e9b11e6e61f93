"""One command, thin verbs. Nothing is imported here: that takes seconds, which a signal may end."""

import sys
from io import TextIOWrapper

from elfslam.app.stopping import run_stoppable


def main() -> None:
    """The `elfslam` command."""
    run_stoppable(_run)


def _run() -> int:
    if isinstance(sys.stdout, TextIOWrapper):  # names may hold what the locale has no bytes for
        sys.stdout.reconfigure(errors="backslashreplace")
    from elfslam.app.console import say_what_is_logged
    from elfslam.cli.app import run

    say_what_is_logged()
    return run(sys.argv[1:])
