"""A recording and a map on disk become fixes; walks without sound become a floor map."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elfslam.app.map import recordings_in, write_merged_map
from elfslam.app.settings import Settings
from elfslam.base.arrays import F32
from elfslam.base.enums import Modality, Mode
from elfslam.base.errors import InputError, NoAnswerError, StoreError
from elfslam.base.parameters import digest
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
from elfslam.data import map_files
from elfslam.data.atomic_files import refuse_occupied, settled
from elfslam.data.building_files import floor_folder, is_building, read_building
from elfslam.data.recordings import read_recording
from elfslam.slam.floor_location import locate_in_building
from elfslam.slam.front_end import extract_echoes
from elfslam.slam.pipeline import locate
from elfslam.stages.checkpoints import CheckpointParameters, gathered, places_visited
from elfslam.stages.device_adaptation import learn_phone
from elfslam.stages.feature import Encoder, extract_features, load_encoder

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
    refuse_other_senses(by)
    refuse_occupied(out, map_files.MERGED if overwrite else None)
    parameters = floor_parameters(settings)
    walks, refused = _walks(paths, by, parameters, announce)
    announce("floor", None)
    turn = floor_turn(walks, parameters)
    headed = [turned(walk, turn.turn_rad) if walk.by_compass else walk for walk in walks]
    trajectories, joined = solved(headed, by, parameters)
    made = replace(
        floor_map(headed, trajectories, by, parameters), parameters_digest=digest(settings)
    )
    told = {
        "by": list(by),
        NORTH: settings.motion.magnetic_north_rad + turn.turn_rad,
        "magnetic_north_sigma_rad": turn.sigma_rad if np.isfinite(turn.sigma_rad) else None,
        "walks": list(made.sources),
        "joined": joined,
        "refused": refused,
    }
    write_merged_map(
        out, made, settings, told=told, refused=refused, encoder=None, overwrite=overwrite,
        trajectories=dict(zip(made.sources, trajectories, strict=True)),
        points_of_interest=_named(headed, trajectories, settings.checkpoint),
    )  # fmt: skip
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
            f"by: wanted wifi, magnetic or both, got {others[0]}; leave it out to go by echoes",
            argument="by",
        )


def _north_of(folder: Path) -> float | None:
    """Where magnetic north lies in a merged map; None where nobody learned it."""
    if not map_files.is_merged(folder):
        return None
    north_rad = map_files.read_object(folder / map_files.MERGED).get(NORTH)
    return north_rad if isinstance(north_rad, int | float) else None


def _walks(
    paths: Sequence[Path], by: Collection[Modality], parameters: FloorParameters, announce: Announce
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
    walks: Sequence[FloorWalk], trajectories: Sequence[Trajectory], parameters: CheckpointParameters
) -> list[PointOfInterest]:
    return gathered(
        [
            point
            for walk, trajectory in zip(walks, trajectories, strict=True)
            for point in places_visited(walk.recording.checkpoints, trajectory, parameters)
        ]
    )


def _refuse_unusable(recording: Recording, by: Collection[Modality], *, alone: bool) -> None:
    if recording.start_pose is None and not alone:
        raise InputError(
            "nobody says where it began; give start_pose [x_m, y_m] in its recording.json"
        )
    if Modality.MAGNETIC in by and recording.magnetometer is None:
        raise InputError("has no magnetometer; leave it out, or merge by wifi", argument="by")
    if Modality.WIFI in by and recording.wifi is None:
        raise InputError("has no Wi-Fi scan; leave it out, or merge by magnetic", argument="by")


def locate_from(
    path: Path,
    map_path: Path,
    settings: Settings,
    *,
    by: Collection[Modality] = (),
    encoder: str | None = None,
    mode: Mode = Mode.ONE_SHOT,
    seed: int = 0,
    phone_walk: Path | None = None,
) -> Fixes:
    """Fixes of the recording at `path` in the map at `map_path`.

    They go `by` the echoes where nothing else is named, by Wi-Fi where the map has no echoes. The
    encoder is the one beside the map where none is named. `phone_walk` is a walk of the same
    phone in that map, to learn how it hears. Raises InputError and StoreError.
    """
    if is_building(settled(map_path)):
        if by and set(by) != {Modality.ELF}:
            raise InputError(
                f"{map_path}: is a building, in which echoes alone locate; name one of its floors "
                f"({floor_folder(map_path, 0)}, say)",
                argument="by",
            )
        return _located_in_building(
            path, map_path, settings, encoder=encoder, mode=mode, seed=seed, phone_walk=phone_walk
        )
    floor_map = map_files.read_map(settled(map_path))
    kinds = {item.kind for item in floor_map.payloads}
    if by or kinds - {Modality.ELF} == kinds:
        senses = by or (Modality.WIFI,)
        return locate_by_field(path, map_path, floor_map, senses, settings, mode)
    headless = map_files.is_superimposed(map_path)
    if headless and mode is not Mode.ONE_SHOT:
        raise InputError(
            f"{map_path}: is superimposed and knows neither headings nor walks, which mode "
            f"{mode} goes by; use one-shot, or the map that it was made of",
            argument="mode",
        )
    used = load_encoder(encoder) if encoder else encoder_of(map_path, floor_map)
    recording = read_recording(path, settings.chirp)
    translation = None
    if phone_walk is not None:
        walk = read_recording(phone_walk, settings.chirp)
        translation = phone_translation(walk, floor_map, used, settings)
    fixes = locate(
        recording, floor_map, used, settings, mode=mode, seed=seed, translation=translation
    )
    return replace(fixes, heading_rad=np.full(len(fixes.t_s), np.nan)) if headless else fixes


def _located_in_building(
    path: Path,
    building: Path,
    settings: Settings,
    *,
    encoder: str | None,
    mode: Mode,
    seed: int,
    phone_walk: Path | None,
) -> Fixes:
    """Fixes with a level each. Raises InputError, StoreError."""
    folders = {level: floor_folder(building, level) for level in read_building(building).levels}
    floors = {level: map_files.read_map(folder) for level, folder in folders.items()}
    first = min(floors)
    used = load_encoder(encoder) if encoder else encoder_of(folders[first], floors[first])
    if phone_walk is not None:
        raise InputError(
            f"{building}: is a building, in which no phone is learned yet; leave it out, or name "
            "one of its floors",
            argument="phone_walk",
        )
    recording = read_recording(path, settings.chirp)
    return locate_in_building(recording, floors, used, settings, mode=mode, seed=seed)


def phone_translation(
    walk: Recording, floor_map: FloorMap, encoder: Encoder, settings: Settings
) -> F32:
    """What a phone's own walk in a map tells of how it hears (cross-device adaptation)."""
    heard = extract_features(extract_echoes(walk, settings), encoder)
    return learn_phone(heard, floor_map, settings.phone)


def encoder_of(path: Path, floor_map: FloorMap) -> Encoder:
    """The encoder beside the map; the one without learning where the map was made with that."""
    spectral = load_encoder("spectral")
    if {item.encoder for item in floor_map.payloads} <= {spectral.identity}:
        return spectral
    beside = (path if path.is_dir() else path.parent) / map_files.ENCODER
    if not beside.is_file():
        raise StoreError(
            f"{beside}: is missing and the map needs it; copy it from the run, name the encoder "
            "(compact is the shipped one), or map the recording again",
            argument="encoder",
        )
    return load_encoder(str(beside))
