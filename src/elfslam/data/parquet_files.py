"""Spots as a Parquet table, a row per spot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.values import FloorMap


def write_parquet(file: Path, floor_map: FloorMap) -> None:
    """Positions, covariances and, a list per spot, what each modality knows there.

    Where the map came from stands in the metadata of the table.
    """
    import pyarrow
    from pyarrow import parquet

    table = pyarrow.table(_columns(floor_map, pyarrow)).replace_schema_metadata(_told(floor_map))
    with file.open("wb") as stream:  # a name of any locale
        parquet.write_table(table, stream)


def _columns(floor_map: FloorMap, pyarrow: Any) -> dict[str, Any]:
    covariance = floor_map.covariance_m2
    columns: dict[str, Any] = {
        "x_m": floor_map.xy_m[:, 0].copy(),
        "y_m": floor_map.xy_m[:, 1].copy(),
        "heading_rad": floor_map.heading_rad,
        "walk": floor_map.walk,
        "order": floor_map.order,
        "covariance_xx_m2": covariance[:, 0, 0].copy(),
        "covariance_xy_m2": covariance[:, 0, 1].copy(),
        "covariance_yy_m2": covariance[:, 1, 1].copy(),
    }
    for payload in floor_map.payloads:
        flat = pyarrow.array(np.ascontiguousarray(payload.vectors).reshape(-1))
        size = payload.vectors.shape[1]
        columns[payload.kind] = pyarrow.FixedSizeListArray.from_arrays(flat, size)
    return columns


def _told(floor_map: FloorMap) -> dict[str, str]:
    encoders = {payload.kind: payload.encoder for payload in floor_map.payloads}
    return {
        "sources": json.dumps(floor_map.sources),
        "encoders": json.dumps(encoders),
        "parameters_digest": floor_map.parameters_digest,
    }
