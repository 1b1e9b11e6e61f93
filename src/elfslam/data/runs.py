"""Runs on disk: what mapping one recording gave, in files that other programs open too."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from elfslam.base import values
from elfslam.base.arrays import F32
from elfslam.base.building import FloorsVisited
from elfslam.base.enums import Modality
from elfslam.base.errors import InputError, StoreError
from elfslam.data import map_files
from elfslam.data.atomic_files import new_folder, sha256_of
from elfslam.data.building_files import is_building, read_building
from elfslam.data.level_files import LEVELS, read_levels, write_levels
from elfslam.data.named_places import read_checkpoints, read_points, write_checkpoints, write_points
from elfslam.data.npz import read_npz, write_npz
from elfslam.data.position_files import read_tum, write_tum
from elfslam.data.recordings import recording_folder
from elfslam.data.tables import read_lines, read_table
from elfslam.data.truth_files import TRUTH_FILES

TIMINGS = "timings.json"
SIMILARITY = "similarity.npz"
CLOSURE_COLUMNS = ("i", "j", "t_i_s", "t_j_s", "score", "weight", "x_m", "y_m", "heading_rad")
UNCERTAINTY = (
    "step_sigma",
    "walk_sigma",
    "trajectory_covariance",
    "closure_covariance",
    "closure_weights",
    "status",
)
SAMPLES = ("samples", "peak")


def write_run(
    run: values.Run,
    folder: Path,
    *,
    facts: Mapping[str, object],
    encoder: bytes | None,
    replace: bool = False,
) -> None:
    """The run as a folder, whole or not at all, see `fill_run`.

    Raises StoreError where a folder with content is there; with `replace` an older run (and
    nothing else) gives way.
    """
    with new_folder(folder, replaces=map_files.FACTS if replace else None) as partial:
        fill_run(run, partial, facts=facts, encoder=encoder)


def fill_run(
    run: values.Run, folder: Path, *, facts: Mapping[str, object], encoder: bytes | None
) -> None:
    """The files of a run in a folder that is there.

    `facts` go into run.json beside the run's name, `encoder` (an ONNX file) into encoder.onnx.
    """
    _write_json(folder / map_files.FACTS, {"name": run.name, **facts})
    _write_json(folder / TIMINGS, run.seconds)
    write_tum(folder / "odometry.tum", run.odometry.t_s, run.odometry.world_from_body)
    write_tum(folder / "trajectory.tum", run.trajectory.t_s, run.trajectory.world_from_body)
    _write_closures(run, folder / "closures.csv")
    _write_evidence(run, folder)
    if run.visited is not None:
        write_levels(run.visited.levels, folder / LEVELS)
    if run.floor_map is not None:
        map_files.write_map(run.floor_map, folder / map_files.MAP)
    if run.points_of_interest:
        write_points(run.points_of_interest, folder)
    if run.checkpoints is not None:
        write_checkpoints(run.checkpoints, folder)
    if encoder is not None:
        (folder / map_files.ENCODER).write_bytes(encoder)


def read_run(folder: Path) -> values.Run:
    """The run in a folder. Raises StoreError where it is missing, cut off or damaged."""
    try:
        return _read_run(folder)
    except (InputError, ValueError, TypeError, IndexError) as cause:
        raise StoreError(f"{folder}: is no whole run ({cause}); map the recording again") from cause


def digest_of(path: Path) -> str:
    """SHA-256 over the names and contents of a recording's files, the same for its .zip.

    The truth is left out: nothing that the pipeline states may depend on it. Raises InputError.
    """
    total = hashlib.sha256()
    with recording_folder(path) as folder:
        for file in sorted(folder.rglob("*")):
            if file.is_file() and file.name not in TRUTH_FILES:
                name = file.relative_to(folder).as_posix()
                total.update(f"{name}\0{sha256_of(file)}\n".encode())
    return total.hexdigest()


def _read_run(folder: Path) -> values.Run:
    facts, timings = map_files.read_facts(folder), map_files.read_object(folder / TIMINGS)
    spread = read_npz(folder / "uncertainty.npz", UNCERTAINTY)
    trajectory_t_s, trajectory_poses = read_tum(folder / "trajectory.tum")
    closures = _read_closures(folder / "closures.csv", spread["closure_covariance"])
    if (np.concatenate([closures.i, closures.j, [0]]) >= len(trajectory_t_s)).any():
        raise InputError(f"closures.csv: names more than {len(trajectory_t_s)} footsteps")
    return values.Run(
        name=str(facts.get("name", folder.name)),
        odometry=values.Odometry(
            *read_tum(folder / "odometry.tum"),
            spread["step_sigma"],
            *spread["walk_sigma"].astype(float).tolist(),
        ),
        similarity=_read_similarity(folder / SIMILARITY),
        closures=closures,
        trajectory=values.Trajectory(
            trajectory_t_s,
            trajectory_poses,
            spread["trajectory_covariance"],
            spread["closure_weights"],
            str(spread["status"]),
        ),
        floor_map=map_files.read_map(folder) if (folder / map_files.MAP).is_file() else None,
        echoes=_read_echoes(folder / "echoes.npz"),
        features=_read_features(folder / "features.npz"),
        seconds={name: float(seconds) for name, seconds in timings.items()},
        points_of_interest=read_points(folder),
        checkpoints=read_checkpoints(folder),
        visited=_read_visited(folder),
    )


def _read_visited(folder: Path) -> FloorsVisited | None:
    """The floors of a run in the folder of its building."""
    if not (is_building(folder) and (folder / LEVELS).is_file()):
        return None
    return FloorsVisited(read_levels(folder / LEVELS), read_building(folder).floors)


def _write_json(file: Path, content: Mapping[str, object]) -> None:
    text = json.dumps(dict(content), indent=2, ensure_ascii=False, default=str)
    file.write_text(text + "\n", encoding="utf-8")


def _write_closures(run: values.Run, file: Path) -> None:
    closures, t_s = run.closures, run.odometry.t_s
    columns = (closures.i, closures.j, t_s[closures.i], t_s[closures.j], closures.score)
    weights = run.trajectory.closure_weights
    table = np.column_stack([*columns, weights, closures.i_from_j])
    formats = ["%d", "%d", "%.6f", "%.6f", *["%.9g"] * 5]
    header = ",".join(CLOSURE_COLUMNS)
    np.savetxt(file, table, fmt=formats, delimiter=",", header=header, comments="")


def _read_closures(file: Path, covariance: npt.NDArray[Any]) -> values.Closures:
    columns = ("i", "j", "score", "x_m", "y_m", "heading_rad")
    empty = len(read_lines(file)) == 1
    table = np.empty((0, len(columns))) if empty else read_table(file, columns)
    i, j = table[:, :2].astype(np.int64).T
    return values.Closures(i, j, table[:, 2], table[:, 3:], covariance)


def _write_evidence(run: values.Run, folder: Path) -> None:
    spread = (
        run.odometry.step_sigma,
        [run.odometry.scale_sigma, run.odometry.heading_drift_sigma_radps],
        run.trajectory.covariance,
        run.closures.covariance,
        run.trajectory.closure_weights,
        run.trajectory.status,
    )
    write_npz(folder / "uncertainty.npz", dict(zip(UNCERTAINTY, spread, strict=True)))
    write_npz(folder / SIMILARITY, _similarity_arrays(run.similarity))
    if run.echoes is not None:
        _write_echoes(run.echoes, folder / "echoes.npz")
    if run.features is not None:
        kept = {name: getattr(run.features, name) for name in ("t_s", "vectors", "attenuation")}
        encoder = map_files.label_of(Modality.ELF, run.features.encoder)
        write_npz(folder / "features.npz", {**kept, "encoder": encoder})


def _similarity_arrays(similarity: values.AnySimilarity) -> dict[str, npt.ArrayLike]:
    if isinstance(similarity, values.MeanSimilarity):
        return {"means": similarity.means, "kind": similarity.kind}
    return {"scores": similarity.scores.astype(np.float16), "kind": similarity.kind}


def _read_similarity(file: Path) -> values.AnySimilarity:
    arrays = read_npz(file, ["kind"])
    if "means" in arrays:
        return values.MeanSimilarity(arrays["means"], str(arrays["kind"]))
    return values.Similarity(read_npz(file, ["scores"])["scores"], str(arrays["kind"]))


def _write_echoes(echoes: values.Echoes, file: Path) -> None:
    """Each trace as float16 of its own peak: half the size, noise 66 dB below the sound."""
    peak = np.max(np.abs(echoes.samples), axis=1, initial=0)
    scaled = echoes.samples / np.where(peak > 0, peak, 1)[:, None]
    arrays = {"samples": scaled.astype(np.float16), "peak": peak}
    kept = {name: getattr(echoes, name) for name in ("t_s", "losses_s")}
    write_npz(file, {**arrays, **kept})


def _read_echoes(file: Path) -> values.Echoes | None:
    if not file.is_file():
        return None
    arrays = read_npz(file, [*SAMPLES, "t_s", "losses_s"])
    samples: F32 = arrays["samples"].astype(np.float32) * arrays["peak"][:, None]
    return values.Echoes(arrays["t_s"], samples, arrays["losses_s"])


def _read_features(file: Path) -> values.Features | None:
    if not file.is_file():
        return None
    arrays = read_npz(file, ["t_s", "vectors", "encoder"])
    encoder = map_files.encoder_of(Modality.ELF, str(arrays["encoder"]))
    attenuation = float(arrays.get("attenuation", 1.0))
    return values.Features(arrays["t_s"], arrays["vectors"], encoder, attenuation)
