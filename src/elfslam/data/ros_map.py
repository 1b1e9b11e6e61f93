"""Maps as the ROS map_server reads them: an image of the floor and a YAML file beside it.

Format: map_server, http://wiki.ros.org/map_server (nav2_map_server reads the same). The image's
first row is the highest y; `origin` is the pose of its lower left corner. A pixel of value v is
occupied with probability (255 - v) / 255: free below `free_thresh`, unknown between the two.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.grid import FloorGrid

FREE, UNKNOWN = 254, 205
FREE_BELOW, OCCUPIED_ABOVE = 0.196, 0.65
"""The thresholds of map_server's own saver; 205 lies just above the first."""


def image_beside(file: Path) -> Path:
    """Where the image of a YAML file goes. Raises InputError where that is not called .yaml."""
    if file.suffix not in (".yaml", ".yml"):
        raise InputError(f"{file}: wanted a name that ends in .yaml (the image goes beside it)")
    return file.with_suffix(".pgm")


def ros_map(grid: FloorGrid, image: str) -> tuple[str, bytes]:
    """The YAML text, which names the image, and the PGM image: free where walked, else unknown."""
    pixels = np.where(grid.free[::-1], FREE, UNKNOWN).astype(np.uint8)
    rows, columns = pixels.shape
    x, y = grid.corner_m.tolist()
    lines = [
        f"image: {json.dumps(image, ensure_ascii=False)}",
        f"resolution: {grid.cell_m:.9g}",
        f"origin: [{x:.6f}, {y:.6f}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {OCCUPIED_ABOVE}",
        f"free_thresh: {FREE_BELOW}",
    ]
    picture = f"P5\n{columns} {rows}\n255\n".encode() + pixels.tobytes()
    return "\n".join(lines) + "\n", picture
