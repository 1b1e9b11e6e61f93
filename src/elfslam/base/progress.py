"""Progress: who hears what is being done."""

from __future__ import annotations

from collections.abc import Callable

Announce = Callable[[str, float | None], None]
"""Hears what is being done, and the share done where it is known."""


def silent(what: str, share: float | None) -> None:
    """Announce nothing."""
