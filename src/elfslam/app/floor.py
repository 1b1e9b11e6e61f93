"""Walks without sound become a floor map, and are located in it: Wi-Fi and the magnetic field."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elfslam.app.map import versions
from elfslam.app.map_many import recordings_in
from elfslam.app.settings import Settings
from elfslam.base.enums import Modality, Mode
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.parameters import as_dict, digest
from elfslam.base.text_files import readable
from elfslam.base.values import Announce, Fixes, FloorMap, PointOfInterest, Recording, Trajectory
from elfslam.baselines.floor_places import floor_places, locate_on_floor
from elfslam.baselines.floor_walks import (
    FloorParameters,
    FloorTurn,
    FloorWalk,
    floor_map,
    floor_turn,
    floor_walk,
    solved,
    turned,
)
from elfslam.data.atomic_files import new_folder, refuse_occupied
from elfslam.data.facts import read_object
from elfslam.data.merged_maps import MERGED, fill_merged, is_merged
from elfslam.data.recordings import read_recording
from elfslam.stages.checkpoints import CheckpointParameters, gathered, places_visited
from elfslam.stages.floormap import map_quality

NORTH = "magnetic_north_rad"
SENSES = (Modality.WIFI, Modality.MAGNETIC)


@dataclass(frozen=True, eq=False)
class FieldFloor:
    """A floor map, the angle of its floor against the compass, the share of its walks that others
    correct, and who stayed out and why."""

    floor_map: FloorMap
    turn: FloorTurn
    joined: float
    refused: dict[str, str]


def merge_by_field(
    out: Path,
    paths: Sequence[Path],
    by: Collection[Modality],
    settings: Settings,
    announce: Announce,
    *,
    overwrite: bool = False,
) -> FieldFloor:
    """Merge recordings, or folders of them, into a map folder with its report.

    Each begins where its recording.json declares, and heads as its phone's sensors say where no
    heading is declared. Raises InputError and NoAnswerError.
    """
    from elfslam.scoring.merged_report import write_merged_report

    refuse_other_senses(by)
    refuse_occupied(out, MERGED if overwrite else None)
    parameters = floor_parameters(settings)
    walks, refused = _walks(paths, by, parameters, announce)
    announce("floor", None)
    turn = floor_turn(walks, parameters)
    headed = [turned(walk, turn.turn_rad) if walk.by_compass else walk for walk in walks]
    trajectories, joined = solved(headed, by, parameters)
    made = replace(
        floor_map(headed, trajectories, by, parameters), parameters_digest=digest(settings)
    )
    quality = map_quality(made, settings.quality)
    facts = {
        **versions(),
        "by": list(by),
        NORTH: settings.motion.magnetic_north_rad + turn.turn_rad,
        "magnetic_north_sigma_rad": turn.sigma_rad if np.isfinite(turn.sigma_rad) else None,
        "walks": list(made.sources),
        "joined": joined,
        "refused": refused,
        "parameters_digest": digest(settings),
        "parameters": as_dict(settings),
    }
    known = dict(zip(made.sources, trajectories, strict=True))
    named = _named(headed, trajectories, settings.checkpoint)
    with new_folder(out, replaces=MERGED if overwrite else None) as partial:
        fill_merged(
            partial, made, quality, known, facts=facts, encoder=None, points_of_interest=named
        )
        write_merged_report(partial / "report.html", made, quality, [], refused)
    return FieldFloor(made, turn, joined, refused)


def locate_by_field(
    path: Path,
    map_path: Path,
    floor_map: FloorMap,
    by: Collection[Modality],
    settings: Settings,
    mode: Mode,
) -> Fixes:
    """Fixes of the recording at `path` in the floor map of the folder; no start is needed.

    It heads as its phone's sensors say, in the frame of the map. Raises InputError, StoreError.
    """
    refuse_other_senses(by)
    parameters = floor_parameters(settings, north_rad=_north_of(map_path))
    places = floor_places(floor_map, by, parameters)
    anywhere = replace(read_recording(path), start_pose=None)
    return locate_on_floor(floor_walk(anywhere, parameters.motion), places, mode)


def floor_parameters(settings: Settings, north_rad: float | None = None) -> FloorParameters:
    """The groups that the floor goes by; magnetic north as the map has it, where that is known."""
    motion = settings.motion
    if north_rad is not None:
        motion = replace(motion, magnetic_north_rad=north_rad)
    return FloorParameters(motion, settings.wifi, settings.neighbours, settings.places)


def refuse_other_senses(by: Collection[Modality]) -> None:
    """Raise InputError where places are to be known by anything but Wi-Fi and the field."""
    others = [sense for sense in by if sense not in SENSES]
    if others:
        raise InputError(
            f"--by: wanted wifi, magnetic or both, got {others[0]}; leave --by out to go by echoes"
        )


def _north_of(folder: Path) -> float | None:
    """Where magnetic north lies in a merged map; None where nobody learned it."""
    if not is_merged(folder):
        return None
    north_rad = read_object(folder / MERGED).get(NORTH)
    return north_rad if isinstance(north_rad, int | float) else None


def _walks(
    paths: Sequence[Path],
    by: Collection[Modality],
    parameters: FloorParameters,
    announce: Announce,
) -> tuple[list[FloorWalk], dict[str, str]]:
    """The walks, each by the name of its folder, and why others stay out."""
    every = [inside for path in paths for inside in recordings_in(path)]
    walks: list[FloorWalk] = []
    refused: dict[str, str] = {}
    for count, path in enumerate(every):
        announce(f"reading {path.name}", count / len(every))
        try:
            recording = replace(read_recording(path), name=readable(path.name))
            _refuse_unusable(recording, by, alone=len(every) == 1)
            walks.append(floor_walk(recording, parameters.motion))
        except InputError as why:
            refused[path.name] = str(why)
    taken = [walk.recording.name for walk in walks]
    if len(set(taken)) < len(taken):
        raise InputError("merge: two recordings have the same name; name each once")
    if not walks:
        name, reason = next(iter(refused.items()))
        raise NoAnswerError(f"merge: no walk could be merged; {name}: {reason}")
    return walks, refused


def _named(
    walks: Sequence[FloorWalk],
    trajectories: Sequence[Trajectory],
    parameters: CheckpointParameters,
) -> list[PointOfInterest]:
    """The places that the walkers named, in the frame of the floor."""
    return gathered(
        [
            point
            for walk, trajectory in zip(walks, trajectories, strict=True)
            for point in places_visited(walk.recording.checkpoints, trajectory, parameters)
        ]
    )


def _refuse_unusable(recording: Recording, by: Collection[Modality], *, alone: bool) -> None:
    """Raise InputError where a walk has no start, or not what places are to be known by."""
    if recording.start_pose is None and not alone:
        raise InputError(
            "nobody says where it began; give start_pose [x_m, y_m] in its recording.json"
        )
    if Modality.MAGNETIC in by and recording.magnetometer is None:
        raise InputError("has no magnetometer; leave it out, or merge --by wifi")
    if Modality.WIFI in by and recording.wifi is None:
        raise InputError("has no Wi-Fi scan; leave it out, or merge --by magnetic")
