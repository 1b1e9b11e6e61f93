"""One command, thin verbs. Nothing is imported here: that takes seconds, which Ctrl-C may end."""

from __future__ import annotations

import sys

from elfslam.app.stopping import run_stoppable


def main() -> None:
    """The `elfslam` command."""
    run_stoppable(_run)


def _run() -> int:
    from elfslam.cli.app import run

    return run(sys.argv[1:])
