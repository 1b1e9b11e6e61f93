"""Just-in-time compilation told: a loop's first use on a machine takes seconds, later ones none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from numba.core.event import Event, Listener, install_listener

from elfslam.base.values import Announce

COMPILED = "numba:compile"
"""What numba calls it when a function is compiled; one that it kept on disk is not."""


class _Told(Listener):  # type: ignore[misc]
    def __init__(self, announce: Announce) -> None:
        self._announce = announce

    def on_start(self, event: Event) -> None:
        self._announce("compiling, only this once", None)

    def on_end(self, event: Event) -> None:
        """Whatever comes next says so itself."""


@contextmanager
def compilation_announced(announce: Announce) -> Iterator[None]:
    """As long as this lasts, what is compiled is announced as it begins."""
    with install_listener(COMPILED, _Told(announce)):
        yield
