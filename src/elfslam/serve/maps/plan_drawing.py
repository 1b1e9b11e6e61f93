"""Draws a plan that is no picture: `python -m elfslam.serve.maps.plan_drawing FILE LEVEL LIMITS`.

A PDF, SVG or GeoJSON may make whoever draws it slow, large or worse, so a process of its own does.
It puts the PNG in the place of the file, and prints how many metres it is wide, as JSON.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from elfslam.base.errors import InputError
from elfslam.data.plan_geojson import LevelError
from elfslam.data.plan_pictures import drawn_picture
from elfslam.serve.receiving.reader import TOO_MUCH_MEMORY, answer
from elfslam.serve.settings import Limits


def draw(file: Path, level: str | None = None) -> dict[str, Any]:
    """What is printed: `width_m`, or a `refusal`, with the `levels` where one is to be chosen."""
    try:
        picture = drawn_picture(file, level)
    except InputError as error:
        levels = {"levels": error.levels} if isinstance(error, LevelError) else {}
        return {"refusal": str(error).replace(f"{file}: ", "the plan "), **levels}
    except MemoryError:
        return {"refusal": TOO_MUCH_MEMORY}
    file.write_bytes(picture.content)
    return {"width_m": picture.width_m}


if __name__ == "__main__":
    told_file, told_level, told_limits = sys.argv[1:]
    chosen = json.loads(told_level)
    sys.exit(answer(Limits(**json.loads(told_limits)), lambda: draw(Path(told_file), chosen)))
