"""A recording on disk becomes a run on disk: what `elfslam map` does, for one or many."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elfslam import __version__
from elfslam.app.settings import Settings, sense_of
from elfslam.app.workers import SerialWorkers, Workers, unit_key
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.enums import Modality
from elfslam.base.errors import InputError, NoAnswerError, ParameterError, StoreError
from elfslam.base.parameters import as_dict, digest
from elfslam.base.values import (
    Announce,
    Echoes,
    FloorMap,
    PointOfInterest,
    Recording,
    Run,
    Trajectory,
    silent,
)
from elfslam.data.atomic_files import new_file, new_folder, refuse_occupied
from elfslam.data.building_files import floor_folder, write_building
from elfslam.data.map_files import BY_TAPS, FACTS, MERGED, MISSING, NOTES, fill_merged, read_facts
from elfslam.data.recordings import read_recording
from elfslam.data.runs import digest_of, fill_run, write_run
from elfslam.learn.parameters import FinetuneParameters
from elfslam.slam import pipeline as slam
from elfslam.slam.coverage import Missing, missing_of
from elfslam.slam.crop import crop
from elfslam.slam.floors import building_of, floor_runs
from elfslam.slam.front_end import extract_echoes, too_noisy, with_missed_half_turn
from elfslam.slam.merging.members import MergeParameters
from elfslam.slam.parameters import Parameters
from elfslam.stages.checkpoints import lies_on_plan
from elfslam.stages.feature import Encoder, OnnxEncoder, load_encoder
from elfslam.stages.floormap import map_quality

if TYPE_CHECKING:
    from elfslam.learn.finetune import Finetuned
    from elfslam.scoring.figures import FloorPlan

FINETUNE_SEED = 0
Pose = tuple[float, float, float]


@dataclass(frozen=True)
class MapJob:
    """How recordings are to be mapped; `by` nothing means by echoes where there is sound.

    A `start_pose` whose heading is NaN leaves that to the compass. `kept_s`, from and until, is the
    stretch of each recording that is mapped; nothing means all of it.
    """

    by: tuple[Modality, ...]
    start_pose: Pose | None
    encoder: str
    parameters: Settings
    overwrite: bool
    finetune: bool = False
    kept_s: tuple[float, float] | None = None


def map_into(
    folder: Path, path: Path, job: MapJob, announce: Announce, floor_plan: FloorPlan | None = None
) -> Run:
    """Map one recording into a run folder with its report, and give the run."""
    refuse_taken(folder, job)
    run, facts, content = mapped_run(path, job, announce)
    if run.visited is None:
        write_reported_run(
            run, folder, facts=facts, encoder=content, floor_plan=floor_plan, replace=job.overwrite
        )
    else:
        _write_building(run, folder, job, facts=facts, encoder=content)
    return run


def _write_building(
    run: Run, folder: Path, job: MapJob, *, facts: Mapping[str, object], encoder: bytes | None
) -> None:
    write_building_run(
        run, folder, facts=facts, encoder=encoder, parameters=line_only(job.parameters),
        overwrite=job.overwrite,
    )  # fmt: skip


def refuse_unclosed(run: Run) -> None:
    """Raise NoAnswerError where closures were looked for and none held."""
    if run.trajectory.status != "OK" and run.similarity.kind != "motion":
        noisy = run.echoes is not None and too_noisy(run.echoes)
        if noisy:
            raise NoAnswerError(f"{run.name}: no loop closure held; {noisy}")
        raise NoAnswerError(
            f"{run.name}: no loop closure held, so the map is as far off as the steps are; "
            "walk the same way at least twice, in the same direction, and map that"
        )


def kept_closures(run: Run) -> int:
    """How many closures the back end trusted."""
    return int((run.trajectory.closure_weights > 0.5).sum())


def write_reported_run(
    run: Run,
    folder: Path,
    *,
    facts: Mapping[str, object],
    encoder: bytes | None,
    floor_plan: FloorPlan | None = None,
    replace: bool = False,
) -> None:
    """The run as a folder that holds its report.html, whole or not at all. See `fill_run`."""
    from elfslam.scoring.report import write_report

    with new_folder(folder, replaces=FACTS if replace else None) as partial:
        fill_run(run, partial, facts=facts, encoder=encoder)
        write_report(partial / "report.html", run, facts=facts, floor_plan=floor_plan)


def write_building_run(
    run: Run,
    folder: Path,
    *,
    facts: Mapping[str, object],
    encoder: bytes | None,
    parameters: Parameters,
    overwrite: bool = False,
) -> None:
    """A run over several floors as a building, each of which is a run folder of its own.

    At the top lies the whole run with the report, without what only its floors need.
    """
    from elfslam.scoring.report import write_report

    parts = floor_runs(run, parameters)
    with new_folder(folder, replaces=FACTS if overwrite else None) as partial:
        whole = replace(run, echoes=None, features=None)
        fill_run(whole, partial, facts=facts, encoder=None)
        write_building(building_of(run, list(parts)), partial)
        write_report(partial / "report.html", whole, facts=facts)
        for level, part in parts.items():
            floor, told = floor_folder(partial, level), {**facts, "level": level}
            floor.mkdir(parents=True)
            fill_run(part, floor, facts=told, encoder=encoder)


def write_merged_map(
    out: Path,
    floor_map: FloorMap,
    parameters: MergeParameters,
    *,
    told: Mapping[str, object],
    trajectories: Mapping[str, Trajectory],
    pairs: Sequence[Mapping[str, object]] = (),
    refused: Mapping[str, str],
    encoder: bytes | None,
    points_of_interest: Sequence[PointOfInterest],
    overwrite: bool,
) -> None:
    """A map of many walks as a folder that holds its report.html, whole or not at all."""
    from elfslam.scoring.merged_report import write_merged_report

    quality = map_quality(floor_map, parameters.quality)
    facts = {
        **versions(),
        **told,
        "parameters_digest": digest(parameters),
        "parameters": as_dict(parameters),
    }
    with new_folder(out, replaces=MERGED if overwrite else None) as partial:
        fill_merged(
            partial, floor_map, quality, trajectories, facts=facts, encoder=encoder,
            points_of_interest=points_of_interest,
        )  # fmt: skip
        write_merged_report(partial / "report.html", floor_map, quality, pairs, refused)


def refuse_taken(folder: Path, job: MapJob) -> None:
    """Raise StoreError before the work where the run could not be written after it."""
    refuse_occupied(folder, FACTS if job.overwrite else None)


@dataclass(frozen=True, eq=False)
class Mapped:
    """A run, the encoder that its map needs, who said which way it heads, what was learnt, and
    what the recording lacked or was not right in it.
    """

    run: Run
    encoder: Encoder | None
    heading: str
    finetuning: str | None
    missing: tuple[Missing, ...] = ()
    notes: tuple[str, ...] = ()


def map_recording(recording: Recording, job: MapJob, announce: Announce = silent) -> Mapped:
    """Map one recording as the job says. Raises InputError, NoAnswerError."""
    if job.kept_s is not None:
        recording = crop(recording, *job.kept_s)
    if job.start_pose is not None:
        recording = replace(recording, start_pose=job.start_pose)
    recording = with_missed_half_turn(recording, job.parameters)
    heard = (Modality.ELF,) if recording.audio is not None else (Modality.MOTION,)
    by = job.by or heard
    if job.finetune and Modality.ELF not in by:
        raise InputError(
            f"{recording.name}: fine-tuning learns echoes; leave it out by {','.join(by)}",
            argument="finetune",
        )
    encoder = load_encoder(job.encoder) if Modality.ELF in by else None
    tuned: list[Finetuned] = []

    def adapt(shipped: Encoder, echoes: Echoes) -> Encoder:
        if not job.finetune:
            return shipped
        known = job.parameters.finetune
        tuned.append(finetuned(shipped, echoes, known, FINETUNE_SEED, announce))
        return tuned[-1].encoder

    run = _map_one(recording, by, encoder, job.parameters, adapt, announce)
    heading = _heading_by(recording, run, job.parameters)
    missing = missing_of(recording, run.echoes, job.parameters.motion)
    kept, learnt = (tuned[-1].encoder, tuned[-1].reason) if tuned else (encoder, None)
    return Mapped(run, kept, heading, learnt, missing, recording.notes)


def _heading_by(recording: Recording, run: Run, parameters: Parameters) -> str:
    """Who says which way a walk heads."""
    if lies_on_plan(recording.checkpoints, run.trajectory, parameters.checkpoint):
        return BY_TAPS
    if run.compass_sigma_rad is not None:
        return f"by compass, to {np.rad2deg(run.compass_sigma_rad):.0f} degrees"
    if recording.imu is None:
        return "by the device's own odometry"
    return "unknown: along x at first" if recording.start_pose is None else "declared"


def mapped_run(
    path: Path, job: MapJob, announce: Announce
) -> tuple[Run, dict[str, Any], bytes | None]:
    """The run of a recording, the facts that run.json states, and the encoder as a file."""
    recording = read_recording(path, job.parameters.chirp)
    made = map_recording(recording, job, announce)
    encoder, echoes = made.encoder, made.run.echoes
    noisy = None if echoes is None else too_noisy(echoes)
    notes = [*made.notes, *([noisy] if noisy else [])]
    facts: dict[str, Any] = {
        **versions(),
        "device": recording.device,
        "recording_digest": digest_of(path),
        "unit": unit_of(path, job),
        "encoder": None if encoder is None else encoder.identity,
        "parameters_digest": digest(line_only(job.parameters)),
        "parameters": as_dict(job.parameters),
        "heading": made.heading,
        **({"finetuning": made.finetuning} if made.finetuning else {}),
        **({"kept_s": list(job.kept_s)} if job.kept_s else {}),
        **({NOTES: notes} if notes else {}),
        **({MISSING: [asdict(each) for each in made.missing]} if made.missing else {}),
        **_verdict(made.run),
    }
    return made.run, facts, encoder.content if isinstance(encoder, OnnxEncoder) else None


def unit_of(path: Path, job: MapJob) -> str:
    """The key of this piece of work: of the recording, the encoder and what the job asks for."""
    return units_of(job)(path)


def units_of(job: MapJob) -> Callable[[Path], str]:
    """`unit_of` for many recordings: the encoder is read once."""
    encoder = load_encoder(job.encoder).identity
    work = partial(mapped_run, job=replace(job, encoder=encoder, overwrite=False))
    return lambda path: unit_key(work, digest_of(path))


def _verdict(run: Run) -> dict[str, str]:
    verdict = run.trajectory.verdict
    return {} if verdict is None else {"closures": str(verdict)}


def finetune_into(
    out: Path,
    path: Path,
    encoder: str,
    settings: Settings,
    *,
    seed: int,
    announce: Announce,
    overwrite: bool = False,
) -> str:
    """Fine-tune the encoder called `encoder` on one recording into the file `out`; what came of it.

    Raises StoreError before the work where `out` cannot be an encoder file, or is there already
    and not to be replaced.
    """
    if out.suffix != ".onnx":
        raise StoreError(f"{out}: wanted the name of a file that ends in .onnx; rename it")
    with new_file(out, overwrite=overwrite, reads=[path, encoder]) as partial:
        announce("echoes", None)
        echoes = extract_echoes(read_recording(path, settings.chirp), settings)
        tuned = finetuned(load_encoder(encoder), echoes, settings.finetune, seed, announce)
        partial.write_bytes(tuned.encoder.content)
    return tuned.reason


def finetuned(
    encoder: Encoder, echoes: Echoes, parameters: FinetuneParameters, seed: int, announce: Announce
) -> Finetuned:
    """What fine-tuning makes of an encoder. Raises InputError."""
    if not isinstance(encoder, OnnxEncoder):
        raise InputError("fine-tuning: wanted an encoder that learns, got spectral; name another")
    from elfslam.learn.finetune import finetune

    return finetune(
        encoder, echoes, parameters, seed=seed,
        report=lambda check: announce("fine-tuning", check.step / parameters.steps),
    )  # fmt: skip


def _map_one(
    recording: Recording,
    by: tuple[Modality, ...],
    encoder: Encoder | None,
    settings: Settings,
    adapt: slam.Adapt,
    announce: Announce,
) -> Run:
    def stage(name: str, share: float | None) -> None:
        announce(f"{recording.name}: {name}", share)

    senses = [sense_of(item, settings) for item in by if item is not Modality.ELF]
    if encoder is None:
        return slam.map_by(recording, senses, settings, announce=stage)
    return slam.map_by_echoes(
        recording, encoder, settings, adapt=adapt, beside=senses, announce=stage
    )


def parse_start(text: str | None) -> Pose | None:
    """The start pose in "X,Y,HEADING" (m, m, rad); "X,Y" leaves the heading (NaN) to the compass.

    Raises ParameterError.
    """
    if text is None:
        return None
    try:
        x_m, y_m, *heading = (float(part) for part in text.split(","))
        (heading_rad,) = heading or (0.0,)
    except ValueError as cause:
        raise ParameterError(
            f"start: wanted X,Y,HEADING (m, m, rad), or X,Y and a compass, got {text!r}",
            argument="start",
        ) from cause
    if not all(abs(number) < FARTHEST_M for number in (x_m, y_m, heading_rad)):
        raise ParameterError(
            f"start: wanted finite numbers, got {text!r}; give metres and radians", argument="start"
        )
    return x_m, y_m, heading_rad if heading else float("nan")


def breaks(echoes: Echoes) -> Iterator[str]:
    """What happened to the stream, a line for each break."""
    for at_s, lost_s in echoes.losses_s:
        if lost_s == 0:
            yield f"playing and recording shifted against each other at {at_s:.1f} s; no sound lost"
        else:
            yield f"the sound lacks {lost_s:.2f} s and jumps at {at_s:.1f} s: taken for lost there"


def line_only(settings: Settings) -> Parameters:
    """The groups that decide what a map looks like."""
    return Parameters(**{name: getattr(settings, name) for name in Parameters.__dataclass_fields__})


def versions() -> dict[str, object]:
    """What made a run: this package, the libraries that decide its numbers, and when."""
    libraries = {name: metadata.version(name) for name in ("numpy", "gtsam", "onnxruntime")}
    made = datetime.now(UTC).isoformat(timespec="seconds")
    return {"elfslam": __version__, "libraries": libraries, "made_utc": made}


def recordings_in(path: Path) -> list[Path]:
    """The recording at `path`, or those in the folder `path`."""
    if path.is_dir() and not (path / "recording.json").exists():
        inside = sorted(item.parent for item in path.glob("[!.]*/recording.json"))
        if inside:
            return inside
    return [path]


def map_many(
    out: Path, paths: list[Path], job: MapJob, announce: Announce, workers: Workers | None = None
) -> dict[str, str]:
    """Map each recording into a folder of `out`; why not, by name, for those that cannot be.

    A run that lies there already and was made of the same recording in the same way stays, so
    that the same call goes on after a kill. No reports are written: `elfslam show` draws any of
    them. `workers` on other machines must see the same folders. Raises StoreError before the
    first where one of the folders holds anything else.
    """
    unit = units_of(job)
    waiting = [path for path in paths if not _is_done(path, out, unit)]
    for path in waiting:
        refuse_taken(out / path.name, job)
    refused: dict[str, str] = {}
    done = len(paths) - len(waiting)
    announce(f"{done} of {len(paths)} recordings", done / len(paths))
    for index, reason in (workers or SerialWorkers()).each(
        partial(_map_next, out=out, job=job), waiting
    ):
        done += 1
        announce(f"{done} of {len(paths)} recordings", done / len(paths))
        if reason:
            refused[waiting[index].name] = reason
    return {path.name: refused[path.name] for path in waiting if path.name in refused}


def _map_next(path: Path, out: Path, job: MapJob) -> str:
    """Why this recording has no run; empty where it has one now."""
    try:
        run, facts, content = mapped_run(path, job, silent)
    except (InputError, NoAnswerError) as error:
        return str(error)
    if run.visited is not None:
        _write_building(run, out / path.name, job, facts=facts, encoder=content)
    else:
        write_run(run, out / path.name, facts=facts, encoder=content, replace=job.overwrite)
    return ""


def _is_done(path: Path, out: Path, unit: Callable[[Path], str]) -> bool:
    if not (out / path.name / FACTS).exists():
        return False
    try:
        return read_facts(out / path.name).get("unit") == unit(path)
    except (InputError, StoreError, OSError):
        return False
