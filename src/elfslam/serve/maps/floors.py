"""Floors by their names: how high they lie, and what those of published buildings are called."""

from __future__ import annotations

import re

DASHES = "-\u2212\u2013"
"""A minus as people write it."""
NUMBER = re.compile(rf"(?:(?<!\w)[{DASHES}])?(?<!\d)\d{{1,3}}(?!\d)")
BASEMENT = re.compile(r"\b(?:basement|cellar|underground)\b|^(?:b|ug)\d", re.I)
GROUND = re.compile(r"\bground\b|\blobby\b|^(?:g|eg|gf)$", re.I)


def level_of(floor: str | None) -> int | None:
    """How high a floor lies by its name, 0 at the ground; None where the name does not say."""
    if floor is None:
        return None
    if GROUND.search(floor):
        return 0
    number, below = NUMBER.search(floor), BASEMENT.search(floor)
    if number is None:
        return -1 if below else None
    level = int(number[0].lstrip(DASHES))
    return -level if below or number[0][0] in DASHES else level


def floor_name(level: int) -> str:
    """What the floor of a published building is called."""
    return "Ground floor" if level == 0 else f"Floor {level}"
