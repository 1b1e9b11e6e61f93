"""Doors of world files: what is written comes out, what cannot hang is refused with its line."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.world.world_file import World, parse_world

FLAT = """
name = "flat"
size_m = [8.0, 4.0, 2.5]
reflection = [0.8, 0.8, 0.8, 0.8, 0.5, 0.7]
seed = 3
route_m = [[0.8, 0.8], [2.2, 0.8], [2.2, 3.2], [0.8, 3.2]]

[[partition]]
name = "south"
from_m = [3.0, 0.0]
to_m = [3.0, 1.5]

[[partition]]
name = "north"
from_m = [3.0, 2.5]
to_m = [3.0, 4.0]

[[furniture]]
name = "shelf"
corner_m = [5.0, 0.0, 0.0]
size_m = [0.4, 0.5, 1.8]

[[door]]
name = "inner"
from_m = [3.0, 1.5]
to_m = [3.0, 2.5]
open_deg = -80.0
material = "glass"

[[door]]
name = "exit"
from_m = [7.9, 0.0]
to_m = [6.1, 0.0]
open_deg = -90.0
leaves = 2
height_m = 2.0
"""
ROW = """
[[door]]
name = "locker"
from_m = [3.5, 4.0]
to_m = [4.0, 4.0]
open_deg = -90.0
repeat = [3, 1]
spacing_m = [1.2, 0.0]
"""


def parsed(text: str) -> World:
    return parse_world(text, "flat.toml")


def test_doors_come_out_as_written() -> None:
    inner, leaving = parsed(FLAT).doors
    assert (inner.name, inner.surface.name, inner.leaves) == ("inner", "glass", 1)
    assert (inner.from_m.tolist(), inner.to_m.tolist()) == ([3.0, 1.5], [3.0, 2.5])
    assert (inner.height_m, inner.open_rad) == (2.1, pytest.approx(np.deg2rad(-80)))
    assert (leaving.surface.name, leaving.leaves, leaving.height_m) == ("door", 2, 2.0)


def test_a_door_is_as_high_as_the_ceiling_at_most() -> None:
    low = FLAT.replace("[8.0, 4.0, 2.5]", "[8.0, 4.0, 2.0]")
    assert parsed(low).doors[0].height_m == 2.0


def test_rows_of_doors_are_numbered() -> None:
    doors = parsed(FLAT + ROW).doors[2:]
    assert [door.name for door in doors] == ["locker 1", "locker 2", "locker 3"]
    assert [door.from_m[0] for door in doors] == pytest.approx([3.5, 4.7, 5.9])


def test_a_world_without_doors_has_none() -> None:
    assert parsed(FLAT.partition("[[door]]")[0]).doors == ()


def test_single_brackets_are_refused() -> None:
    alone = FLAT.partition("[[door]]")[0] + '[door]\nname = "exit"\n'
    with pytest.raises(InputError, match=r"door: wanted \[\[door\]\] tables"):
        parsed(alone)


@pytest.mark.parametrize(
    ("old", "new", "mark", "complaint"),
    [
        ("leaves = 2", "leaves = 3", "leaves", "leaves is 3, wanted a whole number from 1 to 2"),
        ("to_m = [6.1, 0.0]", "to_m = [3.5, 0.0]", "to_m = [3.5", "wanted 0.4 to 2; move an end"),
        ("to_m = [6.1, 0.0]", "to_m = [7.5, 0.0]", "to_m = [7.5", "its leaf is 0.20 m wide"),
        ("height_m = 2.0", "height_m = 2.6", "height_m", "wanted a number from 0.4 to 2.5"),
        ("open_deg = -80.0", "open_deg = 200.0", "open_deg = 200", "number from -180 to 180"),
        ('"glass"', '"glas"', "material", "did you mean 'glass'?"),
        ("open_deg = -80.0", "opens_deg = -80.0", "opens_deg", "did you mean 'open_deg'?"),
        ('name = "exit"', 'name = "inner"', 'name = "inner"\nfrom_m = [7.9', "is taken; give each"),
        ('name = "exit"', 'name = "shelf"', 'name = "shelf"\nfrom_m = [7.9', "is taken; give each"),
        ("to_m = [3.0, 2.5]\nopen", "to_m = [3.0, 2.2]\nopen", "from_m = [3.0, 1.5]",
         "'inner' ends at [3.0, 2.2], 0.15 m or more from any wall or piece; move that end"),
        ("from_m = [3.0, 1.5]\nto_m = [3.0, 2.5]", "from_m = [3.0, 0.3]\nto_m = [3.0, 1.3]",
         "from_m = [3.0, 0.3]", '"south", which has no opening there'),
        ("open_deg = -90.0", "open_deg = 90.0", "from_m = [7.9", "opens into a wall; turn it"),
        ("from_m = [7.9, 0.0]\nto_m = [6.1, 0.0]", "from_m = [6.8, 0.0]\nto_m = [5.2, 0.0]",
         "from_m = [6.8", 'opens into "shelf"; turn it the other way'),
        ("open_deg = -80.0", "open_deg = 80.0", "route_m", 'meets "inner leaf 1"; keep 0.25 m off'),
    ],
)  # fmt: skip
def test_doors_that_cannot_be_are_refused(old: str, new: str, mark: str, complaint: str) -> None:
    wrong = FLAT.replace(old, new, 1)
    assert wrong != FLAT
    with pytest.raises(InputError) as refusal:
        parsed(wrong)
    line = wrong[: wrong.rindex(mark)].count("\n") + 1
    assert str(refusal.value).startswith(f"flat.toml line {line}")
    assert complaint in str(refusal.value)
    assert "\n" not in str(refusal.value)
