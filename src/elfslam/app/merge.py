"""Maps of several walks: run folders merged or added, and one feature per spot for all headings."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elfslam.app.locate import encoder_of
from elfslam.app.map import write_merged_map
from elfslam.app.settings import Settings
from elfslam.base.building import Building, BuildingFloor
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.parameters import digest
from elfslam.base.text_files import readable
from elfslam.base.values import ELF_SIZE, Announce, FloorMap, PointOfInterest, Trajectory
from elfslam.data import map_files
from elfslam.data.atomic_files import new_folder, refuse_occupied, settled
from elfslam.data.building_files import (
    BUILDING,
    floor_folder,
    is_building,
    read_building,
    write_building,
)
from elfslam.data.named_places import read_points
from elfslam.data.runs import read_run
from elfslam.learn.parameters import FloorLevelParameters
from elfslam.slam.merging import MappedWalk, MergeParameters, add_walk, lay_walk, merge, walk_of
from elfslam.slam.merging.floors import (
    MergedFloor,
    add_to_building,
    merged_building,
    merged_floors,
    numbered_alike,
)
from elfslam.stages import floormap
from elfslam.stages.checkpoints import carried, gathered
from elfslam.stages.feature import Encoder, OnnxEncoder
from elfslam.stages.locate import elf_payload
from elfslam.stages.map_alignment import Registration


@dataclass(frozen=True, eq=False)
class Outcome:
    """A map of several walks: trajectories by walk, how pairs came out, who stayed out and why."""

    floor_map: FloorMap
    trajectories: dict[str, Trajectory]
    pairs: list[dict[str, object]]
    refused: dict[str, str]


def merge_into(
    out: Path,
    paths: Sequence[Path],
    parameters: MergeParameters,
    announce: Announce,
    *,
    known_starts: bool = False,
    overwrite: bool = False,
) -> Outcome:
    """Merge runs, the oldest first, or a merged map and runs, into a map folder with its report.

    Raises NoAnswerError where no walk could be merged, InputError where they cannot be compared.
    """
    refuse_occupied(out, map_files.MERGED if overwrite else None)
    bases = [path for path in paths if map_files.is_merged(settled(path))]
    if len(bases) > 1:
        raise InputError(f"merge: wanted one map at most, got {len(bases)}; merge the runs instead")
    if bases and map_files.is_superimposed(settled(bases[0])):
        raise InputError(f"merge: {bases[0]} is superimposed; add walks to the map it was made of")
    walks = _walks([path for path in paths if path not in bases], announce)
    if bases:
        before = map_files.read_map(bases[0])
        made = _grown(before, walks, parameters, announce, known_starts=known_starts)
    else:
        made = _merged(walks, parameters, announce, known_starts=known_starts)
    walked = list(made.floor_map.sources)
    write_merged_map(
        out, made.floor_map, parameters,
        told={"walks": walked, "pairs": made.pairs, "refused": made.refused},
        trajectories=made.trajectories, pairs=made.pairs, refused=made.refused,
        encoder=_encoder_in(paths), overwrite=overwrite,
        points_of_interest=_named(bases, walks, made.trajectories),
    )  # fmt: skip
    return made


def merge_buildings_into(
    out: Path,
    paths: Sequence[Path],
    parameters: MergeParameters,
    announce: Announce,
    *,
    known_starts: bool = False,
    overwrite: bool = False,
) -> tuple[Building, Outcome]:
    """Merge the buildings of single walks into one, a merged map a floor, or add walks to such.

    To a merged building walks of one floor are added as well. Raises NoAnswerError where no walk
    could be merged, InputError where they cannot be compared.
    """
    refuse_occupied(out, BUILDING if overwrite else None)
    bases = [path for path in paths if is_merged_building(path)]
    if len(bases) > 1:
        raise InputError(f"merge: wanted one merged building at most, got {len(bases)}; merge the "
                         "buildings of their walks instead")  # fmt: skip
    others = [path for path in paths if path not in bases]
    if bases:
        made = _grown_building(bases[0], others, parameters, announce, known_starts=known_starts)
    else:
        made = _joined_buildings(out, others, parameters, announce, known_starts=known_starts)
    first = [*bases, *others][0]
    encoder = _encoder_in([floor_folder(first, read_building(first).levels[0])])
    with new_folder(out, replaces=BUILDING if overwrite else None) as partial:
        write_building(made.building, partial)
        for level, floor in made.floors.items():
            write_merged_map(
                floor_folder(partial, level), floor.floor_map, parameters,
                told={"walks": list(floor.floor_map.sources), "level": level},
                trajectories=floor.trajectories, refused=made.outcome.refused, encoder=encoder,
                points_of_interest=made.points_of_interest[level], overwrite=False,
            )  # fmt: skip
    return made.building, made.outcome


def is_merged_building(path: Path) -> bool:
    """Whether a folder holds a building of several walks."""
    return is_building(path) and not (settled(path) / map_files.FACTS).is_file()


@dataclass(frozen=True, eq=False)
class _MadeBuilding:
    """A building of several walks, what was mapped and named on its floors, and how it came out."""

    building: Building
    floors: Mapping[int, MergedFloor]
    points_of_interest: Mapping[int, Sequence[PointOfInterest]]
    outcome: Outcome


def _joined_buildings(
    out: Path,
    paths: Sequence[Path],
    parameters: MergeParameters,
    announce: Announce,
    *,
    known_starts: bool,
) -> _MadeBuilding:
    """The buildings of single walks as one: one frame for all."""
    walks, floors = zip(*[_building_walk(path, announce) for path in paths], strict=True)
    names = [walk.name for walk in walks]
    if len(set(names)) < len(names):
        raise InputError("merge: two buildings have the same name; name each folder once")
    numbered, own_floors = numbered_alike(walks, floors, parameters)
    made = _merged(numbered, parameters, announce, known_starts=known_starts)
    inside = [k for k, walk in enumerate(numbered) if walk.name in made.trajectories]
    taken, known = [numbered[k] for k in inside], [own_floors[k] for k in inside]
    folders = [_floor_folders(paths[k], own_floors[k]) for k in inside]
    trajectories = [made.trajectories[walk.name] for walk in taken]
    merged = merged_floors(taken, trajectories, known, parameters)
    building = merged_building(readable(out.name), taken, trajectories, known, list(merged))
    named = {level: _named_on(folders, taken, floor, level) for level, floor in merged.items()}
    return _MadeBuilding(building, merged, named, made)


def _grown_building(
    base: Path,
    paths: Sequence[Path],
    parameters: MergeParameters,
    announce: Announce,
    *,
    known_starts: bool,
) -> _MadeBuilding:
    """A merged building with the walks that join it, or with all where their starts are known."""
    if not paths:
        raise InputError("merge: wanted walks to add to the building, got none; name some runs")
    made = _merged_before(base)
    for path in paths:
        made = _with_walk(made, path, parameters, announce, known_starts=known_starts)
    if not made.outcome.trajectories:
        name, why = next(iter(made.outcome.refused.items()))
        raise NoAnswerError(f"merge: no walk could be added; {name}: {why}")
    return made


def _merged_before(base: Path) -> _MadeBuilding:
    """A merged building as it lies in a folder, to which nobody was added yet."""
    building = read_building(base)
    folders = {level: floor_folder(base, level) for level in building.levels}
    floors = {level: MergedFloor(map_files.read_map(each), {}) for level, each in folders.items()}
    points = {level: read_points(each) for level, each in folders.items()}
    return _MadeBuilding(
        building, floors, points, Outcome(floors[min(floors)].floor_map, {}, [], {})
    )


def _with_walk(
    made: _MadeBuilding,
    path: Path,
    parameters: MergeParameters,
    announce: Announce,
    *,
    known_starts: bool,
) -> _MadeBuilding:
    """The building with a walk, or as it was with the reason."""
    walk, own = _walk_or_building(path, announce)
    maps = {level: each.floor_map for level, each in made.floors.items()}
    if any(walk.name in each.sources for each in maps.values()):
        raise InputError(f"merge: {walk.name} is in the building already; leave it out")
    building, joined, found, numbered = add_to_building(
        made.building, maps, walk, own, parameters, known_start=known_starts
    )
    before = made.outcome
    outcome = replace(before, pairs=[*before.pairs, _row("building", walk.name, found)])
    if not joined:
        why = f"with the building: {found.refusal}"
        outcome = replace(outcome, refused=before.refused | {walk.name: why})
        return replace(made, outcome=outcome)
    outcome = replace(outcome, trajectories=before.trajectories | {walk.name: walk.trajectory})
    folders = _floor_folders(path, numbered) if own else {numbered[0].level: path}
    floors, points = dict(made.floors), dict(made.points_of_interest)
    for level, each in joined.items():
        others = floors[level].trajectories if level in floors else {}
        floors[level] = replace(each, trajectories=others | each.trajectories)
        named = _named_on([folders], [walk], each, level)
        points[level] = gathered([*points.get(level, ()), *named])
    return _MadeBuilding(building, dict(sorted(floors.items())), points, outcome)


def _walk_or_building(
    path: Path, announce: Announce
) -> tuple[MappedWalk, tuple[BuildingFloor, ...]]:
    """A walk and its floors, of which one that knows no levels has none."""
    if is_building(path):
        return _building_walk(path, announce)
    return _walks([path], announce)[0], ()


def _building_walk(path: Path, announce: Announce) -> tuple[MappedWalk, tuple[BuildingFloor, ...]]:
    """The walk of a building, with what was heard on its floors, and these."""
    name = readable(path.absolute().name)
    announce(f"reading {name}", None)
    run, building = read_run(path), read_building(path)
    heard = [read_run(floor_folder(path, level)).features for level in building.levels]
    if run.visited is None or any(each is None for each in heard):
        raise InputError(f"{path}: was mapped without sound; map it by its echoes")
    known = [each for each in heard if each is not None]
    t_s = np.concatenate([each.t_s for each in known])
    order = np.argsort(t_s)
    vectors = np.concatenate([each.vectors for each in known])[order]
    features = replace(known[0], t_s=t_s[order], vectors=vectors)
    walk = walk_of(replace(run, features=features))
    return replace(walk, name=name, levels=run.visited.levels), building.floors


def _floor_folders(path: Path, numbered: Sequence[BuildingFloor]) -> dict[int, Path]:
    """The folders of a walk's floors, by the level that they have now."""
    own = read_building(path).levels
    return {floor.level: floor_folder(path, k) for floor, k in zip(numbered, own, strict=True)}


def _named_on(
    folders: Sequence[Mapping[int, Path]],
    walks: Sequence[MappedWalk],
    floor: MergedFloor,
    level: int,
) -> list[PointOfInterest]:
    """The points of interest that walks named on a floor, where it lies now."""
    named: list[PointOfInterest] = []
    for own_folders, walk in zip(folders, walks, strict=True):
        after = floor.trajectories.get(walk.name)
        if after is not None and level in own_folders:
            there = np.isin(walk.trajectory.t_s, after.t_s)
            own = read_points(own_folders[level])
            named += carried(own, walk.trajectory.chosen(there), after)
    return gathered(named)


def _merged(
    walks: Sequence[MappedWalk],
    parameters: MergeParameters,
    announce: Announce,
    *,
    known_starts: bool,
) -> Outcome:
    if len(walks) < 2:
        raise InputError(
            f"merge: wanted two walks or a map and a walk, got {len(walks)}; name more"
        )
    found = merge(walks, parameters, known_starts=known_starts, announce=announce)
    pairs = [_row(*names, each) for names, each in found.pairs.items()]
    if not found.maps:
        name, why = next(iter(found.refused.items()))
        raise NoAnswerError(f"merge: no two walks could be merged; {name}: {why}")
    first, *others = found.maps
    apart = {
        name: f"lies in another map, of {', '.join(each.names)}; merge these by themselves"
        for each in others
        for name in each.names
    }
    trajectories = dict(zip(first.names, first.trajectories, strict=True))
    return Outcome(first.floor_map, trajectories, pairs, {**apart, **found.refused})


def _grown(
    floor_map: FloorMap,
    walks: Sequence[MappedWalk],
    parameters: MergeParameters,
    announce: Announce,
    *,
    known_starts: bool,
) -> Outcome:
    """A map with the walks that join it, or with all of them where their starts are known."""
    twice = [walk.name for walk in walks if walk.name in floor_map.sources]
    if twice:
        raise InputError(f"merge: {twice[0]} is in the map already; leave it out")
    if not walks:
        raise InputError("merge: wanted walks to add to the map, got none; name some runs")
    trajectories: dict[str, Trajectory] = {}
    refused: dict[str, str] = {}
    pairs = []
    for count, walk in enumerate(walks):
        announce(f"adding {walk.name}", count / len(walks))
        if known_starts:
            floor_map, trajectories[walk.name] = lay_walk(floor_map, walk, parameters)
            continue
        floor_map, found, trajectory = add_walk(floor_map, walk, parameters)
        pairs.append(_row("map", walk.name, found))
        if found.refusal:
            refused[walk.name] = f"with the map: {found.refusal}"
        else:
            trajectories[walk.name] = trajectory
    if not trajectories:
        name, why = next(iter(refused.items()))
        raise NoAnswerError(f"merge: no walk could be added; {name}: {why}")
    return Outcome(floor_map, trajectories, pairs, refused)


def _walks(paths: Sequence[Path], announce: Announce) -> list[MappedWalk]:
    """The runs, each by the name of its folder, with the one above where several have the same."""
    known = [path.absolute() for path in paths]
    same = Counter(path.name for path in known)
    names = [
        readable(path.name if same[path.name] == 1 else f"{path.parent.name}/{path.name}")
        for path in known
    ]
    if len(set(names)) < len(names):
        raise InputError("merge: two runs have the same name and folder; name each run once")
    walks = []
    for name, path in zip(names, paths, strict=True):
        announce(f"reading {name}", None)
        walks.append(replace(walk_of(read_run(path)), name=name))
    return walks


def _row(one: str, other: str, found: Registration) -> dict[str, object]:
    return {
        "one": one,
        "other": other,
        "places": found.places,
        "resemblance": round(found.resemblance, 3),
        "lead": round(found.lead, 2) if found.lead < 1e6 else None,
        "outcome": found.refusal or "merged",
    }


def _named(
    bases: Sequence[Path], walks: Sequence[MappedWalk], trajectories: Mapping[str, Trajectory]
) -> list[PointOfInterest]:
    """The points of interest of the map that was there, and of the walks that are in it now."""
    named = [point for base in bases for point in read_points(settled(base))]
    for walk in walks:
        if walk.name in trajectories:
            named += carried(walk.points_of_interest, walk.trajectory, trajectories[walk.name])
    return gathered(named)


def _encoder_in(paths: Sequence[Path]) -> bytes | None:
    """The encoder of the first: they are the same, and a map without learning has none."""
    file = paths[0] / map_files.ENCODER
    return file.read_bytes() if file.is_file() else None


def superimpose_into(
    out: Path,
    map_path: Path,
    runs: Sequence[Path],
    settings: Settings,
    announce: Announce,
    *,
    seed: int = 0,
    overwrite: bool = False,
) -> FloorMap:
    """The map folder `out`: one spot per square of the map at `map_path`, alike in any heading.

    Its features are the means of the map's own; with `runs`, walks of that map, its encoder first
    learns from their echoes to hear a spot alike in any heading, and goes on after a kill.
    Raises InputError, StoreError.
    """
    refuse_occupied(out, map_files.MERGED if overwrite else None)
    source = settled(map_path)
    if map_files.is_superimposed(source):
        raise InputError(f"{map_path}: is superimposed already; name the map that it was made of")
    floor_map = map_files.read_map(source)
    encoder = encoder_of(source, floor_map)
    if runs:
        walks = [_placed(source, run, announce) for run in runs]
        made, encoder = _learned(out, floor_map, walks, encoder, settings, announce, seed=seed)
    else:
        elfs = elf_payload(floor_map, encoder.identity, ELF_SIZE)
        made = floormap.superimposed(floor_map, elfs, settings.floor_level.spacing_m)
    made = replace(made, parameters_digest=digest(settings))
    told = {"walks": list(made.sources), "learned_from": [run.name for run in runs]}
    write_merged_map(
        out, made, settings, told={map_files.SUPERIMPOSED: True, **told}, trajectories={},
        refused={}, encoder=encoder.content if isinstance(encoder, OnnxEncoder) else None,
        points_of_interest=read_points(source), overwrite=overwrite,
    )  # fmt: skip
    if runs:
        _checkpoint(out).unlink(missing_ok=True)
    return made


def _placed(map_path: Path, path: Path, announce: Announce) -> floormap.SpotEchoes:
    """The echoes of a run where the map has them. Raises InputError where it has no such walk."""
    announce(f"reading {path.name}", None)
    echoes = read_run(path).echoes
    if echoes is None:
        raise InputError(f"{path}: holds no echoes; map its recording again, by its echoes")
    t_s, poses = map_files.walk_in(map_path, readable(path.name))
    inside = (echoes.t_s >= t_s[0]) & (echoes.t_s <= t_s[-1])
    if not inside.any():
        raise InputError(f"{path}: is not the walk of that name in {map_path}; check both")
    where = interpolate_poses(t_s, poses, echoes.t_s[inside])
    return floormap.SpotEchoes(echoes.samples[inside], where[:, :2], where[:, 2])


def _learned(
    out: Path,
    floor_map: FloorMap,
    walks: Sequence[floormap.SpotEchoes],
    encoder: Encoder,
    settings: Settings,
    announce: Announce,
    *,
    seed: int,
) -> tuple[FloorMap, OnnxEncoder]:
    from elfslam.learn.floor_level import floor_elfs, learn_floor

    if not isinstance(encoder, OnnxEncoder):
        raise InputError("superimpose: the map's encoder cannot learn; leave the runs out")
    parameters = settings.floor_level
    spots_m = floormap.floor_spots(np.vstack([walk.xy_m for walk in walks]), parameters.spacing_m)
    learned = learn_floor(
        encoder, spots_m, lambda step: drawn(walks, parameters, seed, step), parameters,
        seed=seed, checkpoint=_checkpoint(out),
        report=lambda at: announce(f"learning, loss {at.loss:.2f}", at.step / parameters.steps),
    ).encoder  # fmt: skip
    vectors = floor_elfs(learned, spots_m, walks)
    made = floormap.superimposed_map(
        spots_m, vectors, learned.identity, spacing_m=parameters.spacing_m,
        sources=floor_map.sources, covariance_m2=floormap.nearest_covariance(floor_map, spots_m),
    )  # fmt: skip
    return made, learned


def drawn(
    walks: Sequence[floormap.SpotEchoes], parameters: FloorLevelParameters, seed: int, step: int
) -> floormap.SpotEchoes:
    """The echoes that a step learns from: as many of each walk, the same for a seed and step."""
    generator = np.random.default_rng([seed, 1, step])
    each = -(-parameters.batch // len(walks))
    rows = [generator.integers(0, len(walk.xy_m), each) for walk in walks]
    pairs = list(zip(walks, rows, strict=True))
    return floormap.SpotEchoes(
        np.concatenate([walk.samples[some] for walk, some in pairs]),
        np.concatenate([walk.xy_m[some] for walk, some in pairs]),
        np.concatenate([walk.heading_rad[some] for walk, some in pairs]),
    )


def _checkpoint(out: Path) -> Path:
    return out.with_name(f"{out.name}.checkpoint")
