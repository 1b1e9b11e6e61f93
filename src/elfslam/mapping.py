"""A recording on disk becomes a run on disk: what `elfslam map` does, for one or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from enum import StrEnum
from importlib import metadata
from pathlib import Path
from typing import Any

from elfslam import __version__, slam
from elfslam.base.errors import InputError, NoAnswerError, ParameterError
from elfslam.base.parameters import as_dict, digest
from elfslam.base.values import Odometry, Recording, Similarity
from elfslam.baselines.magnetic import MagneticParameters, magnetic_similarity
from elfslam.data.folders import new_folder, refuse_occupied
from elfslam.data.recordings import read_recording
from elfslam.data.runs import FACTS, digest_of, write_run
from elfslam.learn.settings import PretrainParameters
from elfslam.line.feature import Encoder, OnnxEncoder, load_encoder
from elfslam.score.figures import FloorPlan
from elfslam.score.report import write_report

Announce = Callable[[str, float | None], None]
"""Hears what is being done, and the share done where it is known."""
FARTHEST_M = 1e6
Pose = tuple[float, float, float]


@dataclass(frozen=True)
class Settings(slam.Parameters):
    """Every parameter there is: the line's, the rivals' and the training's."""

    magnetic: MagneticParameters = field(default_factory=MagneticParameters)
    pretrain: PretrainParameters = field(default_factory=PretrainParameters)


class Modality(StrEnum):
    """What closes the loops."""

    ELF = "elf"
    MAGNETIC = "magnetic"
    MOTION = "motion"


@dataclass(frozen=True)
class MapJob:
    """How recordings are to be mapped."""

    by: Modality | None
    start_pose: Pose | None
    encoder: str
    parameters: Settings
    overwrite: bool


def recordings_in(path: Path) -> list[Path]:
    """The recording at `path`, or those in the folder `path`."""
    if path.is_dir() and not (path / "recording.json").exists():
        inside = sorted(item.parent for item in path.glob("*/recording.json"))
        if inside:
            return inside
    return [path]


def map_many(out: Path, paths: list[Path], job: MapJob, announce: Announce) -> dict[str, str]:
    """Map each recording into a folder of `out`; why not, by name, for those that cannot be.

    No reports are written: `elfslam show` draws any of them. Raises StoreError before the first
    where one of the folders is taken.
    """
    for path in paths:
        _refuse(out / path.name, job)
    refused: dict[str, str] = {}
    for count, path in enumerate(paths):
        announce(path.name, count / len(paths))
        try:
            run, facts, content = _mapped(path, job, lambda what, share: None)
        except (InputError, NoAnswerError) as error:
            refused[path.name] = str(error)
            continue
        folder = out / path.name
        write_run(run, folder, facts=facts, encoder=content, replace=job.overwrite)
    return refused


def map_into(
    folder: Path, path: Path, job: MapJob, announce: Announce, floor_plan: FloorPlan | None = None
) -> slam.Run:
    """Map one recording into a run folder with its report, and give the run."""
    _refuse(folder, job)
    run, facts, content = _mapped(path, job, announce)
    write_reported_run(
        run, folder, facts=facts, encoder=content, floor_plan=floor_plan, replace=job.overwrite
    )
    return run


def write_reported_run(
    run: slam.Run,
    folder: Path,
    *,
    facts: Mapping[str, object],
    encoder: bytes | None,
    floor_plan: FloorPlan | None = None,
    replace: bool = False,
) -> None:
    """The run as a folder that holds its report.html, whole or not at all. See `write_run`."""
    with new_folder(folder, replaces=FACTS if replace else None) as partial:
        write_run(run, partial, facts=facts, encoder=encoder)
        write_report(partial / "report.html", run, facts=facts, floor_plan=floor_plan)


def _refuse(folder: Path, job: MapJob) -> None:
    """Raise StoreError before the work where the run could not be written after it."""
    refuse_occupied(folder, FACTS if job.overwrite else None)


def _mapped(
    path: Path, job: MapJob, announce: Announce
) -> tuple[slam.Run, dict[str, Any], bytes | None]:
    """The run of a recording, the facts that run.json states, and the encoder as a file."""
    recording = read_recording(path, job.parameters.chirp)
    if job.start_pose is not None:
        recording = replace(recording, start_pose=job.start_pose)
    by = job.by or (Modality.ELF if recording.audio is not None else Modality.MOTION)
    encoder = load_encoder(job.encoder) if by is Modality.ELF else None
    run = _map_one(recording, by, encoder, job.parameters, announce)
    facts: dict[str, Any] = {
        **versions(),
        "device": recording.device,
        "recording_digest": digest_of(path),
        "encoder": None if encoder is None else encoder.identity,
        "parameters_digest": digest(line_only(job.parameters)),
        "parameters": as_dict(job.parameters),
    }
    return run, facts, encoder.content if isinstance(encoder, OnnxEncoder) else None


def _map_one(
    recording: Recording, by: Modality, encoder: Encoder | None, known: Settings, announce: Announce
) -> slam.Run:
    def stage(name: str) -> None:
        announce(f"{recording.name}: {name}", None)

    if encoder is not None:
        return slam.map_by_echoes(recording, encoder, known, announce=stage)
    makers = {
        Modality.MOTION: slam.no_similarity,
        Modality.MAGNETIC: lambda walk, nodes: _field_similarity(walk, nodes, known.magnetic),
    }
    return slam.map_by(recording, makers[by], known, announce=stage)


def _field_similarity(
    recording: Recording, nodes: Odometry, known: MagneticParameters
) -> Similarity:
    if recording.magnetometer is None:
        raise InputError(f"{recording.name}: no magnetometer; map it with --by elf or motion")
    return magnetic_similarity(recording.magnetometer, recording.orientation, nodes, known)


def parse_start(text: str | None) -> Pose | None:
    """The start pose in "X,Y,HEADING" (m, m, rad). Raises ParameterError."""
    if text is None:
        return None
    try:
        x_m, y_m, heading_rad = (float(part) for part in text.split(","))
    except ValueError as cause:
        raise ParameterError(f"--start: wanted X,Y,HEADING (m, m, rad), got {text!r}") from cause
    if not all(abs(number) < FARTHEST_M for number in (x_m, y_m, heading_rad)):
        raise ParameterError(
            f"--start: wanted finite numbers, got {text!r}; give metres and radians"
        )
    return x_m, y_m, heading_rad


def line_only(known: Settings) -> slam.Parameters:
    """The groups that decide what a map looks like."""
    return slam.Parameters(
        **{name: getattr(known, name) for name in slam.Parameters.__dataclass_fields__}
    )


def versions() -> dict[str, object]:
    """What made a run: this package, the libraries that decide its numbers, and when."""
    libraries = {name: metadata.version(name) for name in ("numpy", "gtsam", "onnxruntime")}
    made = datetime.now(UTC).isoformat(timespec="seconds")
    return {"elfslam": __version__, "libraries": libraries, "made_utc": made}
