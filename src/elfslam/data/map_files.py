"""Floor maps on disk: one .npz file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from elfslam.base.bounds import FARTHEST_M
from elfslam.base.enums import Modality
from elfslam.base.errors import InputError, StoreError
from elfslam.base.values import FloorMap, Payload
from elfslam.data.npz import read_npz, write_npz

MAP = "map.npz"
SPOTS = ("xy_m", "heading_rad", "walk", "order", "covariance_m2")
AGEING = ("weight", "changed")
"""What maps of one walk may lack."""
OWN = "-own"
"""Behind an encoder's name: its features have lost what the echoes of a walk have in common. Those
of earlier versions have not and cannot be compared with them."""
LABELS = ("parameters_digest", "sources", "payload_kinds", "payload_encoders")


def write_map(floor_map: FloorMap, file: Path) -> None:
    """The map as an .npz file."""
    arrays = {name: getattr(floor_map, name) for name in (*SPOTS, *AGEING)}
    arrays["parameters_digest"] = floor_map.parameters_digest
    arrays["sources"] = np.array(floor_map.sources, dtype=str)
    arrays["payload_kinds"] = np.array([each.kind for each in floor_map.payloads], dtype=str)
    encoders = [label_of(each.kind, each.encoder) for each in floor_map.payloads]
    arrays["payload_encoders"] = np.array(encoders, dtype=str)
    for k, payload in enumerate(floor_map.payloads):
        arrays[f"payload_{k}"] = payload.vectors
    write_npz(file, arrays)


def read_map(path: Path) -> FloorMap:
    """The map in a run folder or an .npz file. Raises StoreError."""
    file = path / MAP if path.is_dir() else path
    arrays = read_npz(file, [*SPOTS, *LABELS])
    try:
        _check_places(arrays["xy_m"])
        kinds, labels = _texts(arrays, "payload_kinds"), _texts(arrays, "payload_encoders")
        return FloorMap(
            **{name: arrays[name] for name in (*SPOTS, *AGEING) if name in arrays},
            payloads=tuple(
                Payload(kind, encoder_of(kind, label), arrays[f"payload_{k}"])
                for k, (kind, label) in enumerate(zip(kinds, labels, strict=True))
            ),
            parameters_digest=str(arrays["parameters_digest"]),
            sources=_texts(arrays, "sources"),
        )
    except (InputError, KeyError, TypeError, ValueError) as cause:
        raise StoreError(f"{file}: is no floor map ({cause}); make it again") from cause


def label_of(kind: str, encoder: str) -> str:
    """What a file calls the encoder of such features."""
    return encoder + OWN if kind == Modality.ELF else encoder


def encoder_of(kind: str, label: str) -> str:
    """The encoder that a file means. Raises ValueError where an earlier version wrote it."""
    if kind == Modality.ELF and not label.endswith(OWN):
        raise ValueError("its features are those of an earlier version")
    return label.removesuffix(OWN)


def _check_places(xy_m: npt.NDArray[Any]) -> None:
    """Raises ValueError where spots lie beyond any building."""
    # NaN fails the comparison.
    if xy_m.dtype.kind == "f" and not (np.abs(xy_m) <= FARTHEST_M).all():
        raise ValueError(f"its spots lie up to {np.abs(xy_m).max():g} m away")


def _texts(arrays: Mapping[str, npt.NDArray[Any]], name: str) -> tuple[str, ...]:
    """A list of texts. Raises ValueError where the array is anything else."""
    given = arrays[name]
    if given.ndim != 1 or (given.dtype.kind != "U" and len(given)):
        raise ValueError(f"{name} is {given.dtype} of shape {given.shape}, wanted a list of texts")
    return tuple(given.tolist())
