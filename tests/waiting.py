"""Waiting for what other processes do, in one place: what never comes is a TimeoutError."""

import time
from collections.abc import Callable
from typing import TypeVar

Thing = TypeVar("Thing")
PATIENCE_S = 120.0


def nap() -> None:
    """Let others work; who asks a server so is below the 30 requests a second that it allows."""
    time.sleep(0.05)


def until(
    find: Callable[[], Thing],
    what: str,
    *,
    patience_s: float = PATIENCE_S,
    between: Callable[[], object] = nap,
) -> Thing:
    """What `find` gives, as soon as it is true. Raises TimeoutError where that never comes."""
    end_s = time.monotonic() + patience_s
    while not (found := find()):
        if time.monotonic() > end_s:
            raise TimeoutError(f"{what}: never came in {patience_s:g} s")
        between()
    return found
