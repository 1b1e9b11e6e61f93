"""What lies in the folder of a run or of a map of many walks: facts, and floor maps (.npz)."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from elfslam.base.arrays import F64
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.enums import Modality
from elfslam.base.errors import InputError, StoreError
from elfslam.base.text_files import read_json
from elfslam.base.values import FloorMap, Payload, PointOfInterest, Trajectory
from elfslam.data.building_files import FLOORS, is_building
from elfslam.data.named_places import write_points
from elfslam.data.npz import read_npz, write_npz
from elfslam.data.position_files import read_tum, write_tum
from elfslam.stages.floormap import MapQuality

FACTS, ENCODER = "run.json", "encoder.onnx"
BY_TAPS = "by taps on a floor plan"
"""The `heading` of a walk that lies where its walker tapped."""
MISSING, NOTES = "missing", "notes"
"""Under these names run.json lists the stretches in which the recording lacked sound or motion,
and what else was not as it should be."""


def read_facts(folder: Path) -> dict[str, Any]:
    """What run.json says: parameters, digests, versions. Raises StoreError."""
    return read_object(folder / FACTS)


def read_object(file: Path) -> dict[str, Any]:
    """The JSON object in a file of a run. Raises StoreError where it is missing or damaged."""
    try:
        content = read_json(file)
    except InputError as cause:
        raise StoreError(f"{file}: is missing or damaged ({cause}); map again") from cause
    if not isinstance(content, dict):
        raise StoreError(f"{file}: wanted a JSON object; map the recording again")
    return content


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
    if is_building(path):
        raise StoreError(
            f"{path}: is a building, wanted one floor; name one of its folders in {path / FLOORS}"
        )
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
    given = arrays[name]
    if given.ndim != 1 or (given.dtype.kind != "U" and len(given)):
        raise ValueError(f"{name} is {given.dtype} of shape {given.shape}, wanted a list of texts")
    return tuple(given.tolist())


MERGED = "merge.json"
QUALITY = "quality.csv"
SUPERIMPOSED = "superimposed"
TRAJECTORIES = "trajectories"
QUALITY_COLUMNS = (
    "x_m", "y_m", "walks", "spots", "weight", "sigma_m", "error_m", "changed"
)  # fmt: skip


def is_merged(path: Path) -> bool:
    """Whether a folder holds a map of many walks."""
    return (path / MERGED).is_file()


def is_superimposed(path: Path) -> bool:
    """Whether a folder holds a map of one spot for all headings, so that its own say nothing."""
    return is_merged(path) and read_object(path / MERGED).get(SUPERIMPOSED) is True


def walk_in(path: Path, name: str) -> tuple[F64, F64]:
    """Times (n) and poses (n, 3) of a walk in a merged map, in its frame.

    Raises InputError where the map does not hold them.
    """
    file = path / TRAJECTORIES / f"{name.replace('/', '-')}.tum"
    if not file.is_file():
        raise InputError(f"{path}: has no trajectory of {name}; merge its runs anew, all at once")
    return read_tum(file)


def fill_merged(
    folder: Path,
    floor_map: FloorMap,
    quality: MapQuality,
    trajectories: Mapping[str, Trajectory],
    *,
    facts: Mapping[str, object],
    encoder: bytes | None,
    points_of_interest: Sequence[PointOfInterest] = (),
) -> None:
    """Into a folder that is there: map.npz, quality.csv, trajectories, and what the facts say."""
    write_map(floor_map, folder / MAP)
    write_quality(quality, folder / QUALITY)
    (folder / TRAJECTORIES).mkdir()
    for name, walk in trajectories.items():
        file = folder / TRAJECTORIES / f"{name.replace('/', '-')}.tum"
        write_tum(file, walk.t_s, walk.world_from_body)
    text = json.dumps(dict(facts), indent=2, ensure_ascii=False, default=str)
    (folder / MERGED).write_text(text + "\n", encoding="utf-8")
    if encoder is not None:
        (folder / ENCODER).write_bytes(encoder)
    if points_of_interest:
        write_points(points_of_interest, folder)


def write_quality(quality: MapQuality, file: Path) -> None:
    """A row per square metre that holds spots; an error that nobody knows stays empty."""
    counts = [quality.walks, quality.spots]
    metres = [quality.weight, quality.sigma_m, quality.error_m, quality.changed]
    table = np.column_stack([quality.xy_m, *counts, *metres])
    rows = [",".join("" if np.isnan(value) else f"{value:.9g}" for value in row) for row in table]
    file.write_text("\n".join([",".join(QUALITY_COLUMNS), *rows]) + "\n", encoding="utf-8")
