"""Spots as Parquet, read back by pyarrow."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.testing as npt
from pyarrow import parquet

from elfslam.base.values import FloorMap, Payload
from elfslam.data.map_exports import write_parquet

RANDOM = np.random.default_rng(5)
PAYLOAD = Payload("elf", "compact", RANDOM.normal(size=(4, 3)).astype(np.float32))
MAP = FloorMap(
    RANDOM.normal(size=(4, 2)),
    RANDOM.normal(size=4),
    np.array([0, 0, 1, 1]),
    np.array([0, 1, 0, 1]),
    np.array([[[2.0, 0.5], [0.5, 1.0]], [[1.0, -0.3], [-0.3, 4.0]], np.eye(2), 0.1 * np.eye(2)]),
    (PAYLOAD,),
    "abc",
    ("Zürich", "b"),
)


def test_every_spot_is_a_row(tmp_path: Path) -> None:
    write_parquet(tmp_path / "spots.parquet", MAP)
    table = parquet.read_table(tmp_path / "spots.parquet")
    rows = table.to_pylist()
    npt.assert_array_equal([[row["x_m"], row["y_m"]] for row in rows], MAP.xy_m)
    npt.assert_array_equal([row["heading_rad"] for row in rows], MAP.heading_rad)
    npt.assert_array_equal(
        [[row["walk"], row["order"]] for row in rows], [[0, 0], [0, 1], [1, 0], [1, 1]]
    )
    npt.assert_array_equal([row["covariance_xy_m2"] for row in rows], MAP.covariance_m2[:, 0, 1])
    npt.assert_array_equal([row["covariance_yy_m2"] for row in rows], MAP.covariance_m2[:, 1, 1])
    npt.assert_array_equal(np.array([row["elf"] for row in rows], np.float32), PAYLOAD.vectors)
    told = table.schema.metadata
    assert json.loads(told[b"sources"]) == ["Zürich", "b"]
    assert json.loads(told[b"encoders"]) == {"elf": "compact"}
