"""ROS maps, read by the rules of map_server."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.grid import FloorGrid, walked_grid
from elfslam.data.map_exports import image_beside, ros_map


def served(file: Path, xy_m: F64) -> list[str]:
    """What map_server says of points: trinary mode, the image's first row on top."""
    told = dict(line.split(": ", 1) for line in file.read_text().splitlines())
    assert told["negate"] == "0"
    image = (file.parent / told["image"].strip('"')).read_bytes()
    magic, size, top, pixels = image.split(b"\n", 3)
    assert (magic, top) == (b"P5", b"255")
    columns, rows = map(int, size.split())
    grid = np.frombuffer(pixels, dtype=np.uint8).reshape(rows, columns)
    origin = [float(cell) for cell in told["origin"].strip("[]").split(",")]
    assert origin[2] == 0.0
    at = np.floor((xy_m - origin[:2]) / float(told["resolution"])).astype(int)
    occupied = (255 - grid[rows - 1 - at[:, 1], at[:, 0]]) / 255.0
    return [
        "occupied"
        if p > float(told["occupied_thresh"])
        else "free"
        if p < float(told["free_thresh"])
        else "unknown"
        for p in occupied
    ]


def written(file: Path, grid: FloorGrid) -> None:
    """The files of a ROS map."""
    image = image_beside(file)
    text, content = ros_map(grid, image.name)
    file.write_text(text, encoding="utf-8")
    image.write_bytes(content)


def test_walked_ground_is_free_and_the_rest_unknown(tmp_path: Path) -> None:
    line = np.array([[-1.0, 2.0], [3.0, 2.0], [3.0, 7.0]])
    written(tmp_path / "floor.yaml", walked_grid([line], 0.25, 0.05))
    beside = line + np.array([[0.0, 0.2], [0.2, 0.0], [-0.2, 0.0]])
    assert served(tmp_path / "floor.yaml", np.vstack([line, beside])) == ["free"] * 6
    off = np.array([[1.0, 2.35], [0.0, 5.0], [3.28, 7.0]])
    assert served(tmp_path / "floor.yaml", off) == ["unknown"] * 3


def test_every_square_comes_back(tmp_path: Path) -> None:
    free = np.random.default_rng(3).random((7, 4)) < 0.5
    written(tmp_path / "m.yml", FloorGrid(free, np.array([-3.2, 1.6]), 0.4))
    x, y = np.meshgrid(-3.2 + 0.4 * (np.arange(4) + 0.5), 1.6 + 0.4 * (np.arange(7) + 0.5))
    said = served(tmp_path / "m.yml", np.column_stack([x.ravel(), y.ravel()]))
    npt.assert_array_equal(np.array(said).reshape(7, 4) == "free", free)
    assert set(said) == {"free", "unknown"}


def test_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.yaml"):
        image_beside(tmp_path / "m.pgm")
