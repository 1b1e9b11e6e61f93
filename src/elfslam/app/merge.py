"""Run folders become a map folder, or join one: what `elfslam merge` does."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from elfslam.app.map import versions
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.parameters import as_dict, digest
from elfslam.base.text_files import readable
from elfslam.base.values import Announce, FloorMap, PointOfInterest, Trajectory
from elfslam.data.atomic_files import new_folder, refuse_occupied, settled
from elfslam.data.facts import ENCODER
from elfslam.data.map_files import read_map
from elfslam.data.merged_maps import MERGED, fill_merged, is_merged, is_superimposed
from elfslam.data.points_of_interest_files import read_points
from elfslam.data.runs import read_run
from elfslam.scoring.merged_report import write_merged_report
from elfslam.slam.merging import MappedWalk, MergeParameters, add_walk, lay_walk, merge, walk_of
from elfslam.stages.checkpoints import carried, gathered
from elfslam.stages.floormap import map_quality
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
    refuse_occupied(out, MERGED if overwrite else None)
    bases = [path for path in paths if is_merged(settled(path))]
    if len(bases) > 1:
        raise InputError(f"merge: wanted one map at most, got {len(bases)}; merge the runs instead")
    if bases and is_superimposed(settled(bases[0])):
        raise InputError(f"merge: {bases[0]} is superimposed; add walks to the map it was made of")
    walks = _walks([path for path in paths if path not in bases], announce)
    if bases:
        grown = _laid if known_starts else _grown
        made = grown(read_map(bases[0]), walks, parameters, announce)
    else:
        made = _merged(walks, parameters, announce, known_starts=known_starts)
    quality = map_quality(made.floor_map, parameters.quality)
    facts = {
        **versions(),
        "walks": list(made.floor_map.sources),
        "pairs": made.pairs,
        "refused": made.refused,
        "parameters_digest": digest(parameters),
        "parameters": as_dict(parameters),
    }
    with new_folder(out, replaces=MERGED if overwrite else None) as partial:
        content = (made.floor_map, quality, made.trajectories)
        fill_merged(
            partial, *content, facts=facts, encoder=_encoder_in(paths),
            points_of_interest=_named(bases, walks, made.trajectories),
        )  # fmt: skip
        report = partial / "report.html"
        write_merged_report(report, made.floor_map, quality, made.pairs, made.refused)
    return made


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
        raise NoAnswerError(f"merge: no two walks could be merged; {name} {why}")
    first, *others = found.maps
    apart = {
        name: f"lies in another map, of {', '.join(each.names)}; merge these by themselves"
        for each in others
        for name in each.names
    }
    trajectories = dict(zip(first.names, first.trajectories, strict=True))
    return Outcome(first.floor_map, trajectories, pairs, {**apart, **found.refused})


def _laid(
    floor_map: FloorMap,
    walks: Sequence[MappedWalk],
    parameters: MergeParameters,
    announce: Announce,
) -> Outcome:
    """The map with walks that lie in its frame already."""
    _check_new(floor_map, walks)
    trajectories: dict[str, Trajectory] = {}
    for count, walk in enumerate(walks):
        announce(f"adding {walk.name}", count / len(walks))
        floor_map, trajectories[walk.name] = lay_walk(floor_map, walk, parameters)
    return Outcome(floor_map, trajectories, [], {})


def _check_new(floor_map: FloorMap, walks: Sequence[MappedWalk]) -> None:
    twice = [walk.name for walk in walks if walk.name in floor_map.sources]
    if twice or not walks:
        raise InputError(
            f"merge: {twice[0]} is in the map already; leave it out"
            if twice
            else "merge: wanted walks to add to the map, got none; name some runs"
        )


def _grown(
    floor_map: FloorMap,
    walks: Sequence[MappedWalk],
    parameters: MergeParameters,
    announce: Announce,
) -> Outcome:
    _check_new(floor_map, walks)
    trajectories: dict[str, Trajectory] = {}
    refused: dict[str, str] = {}
    pairs = []
    for count, walk in enumerate(walks):
        announce(f"adding {walk.name}", count / len(walks))
        floor_map, found, trajectory = add_walk(floor_map, walk, parameters)
        pairs.append(_row("map", walk.name, found))
        if found.refusal:
            refused[walk.name] = f"with the map: {found.refusal}"
        else:
            trajectories[walk.name] = trajectory
    if not trajectories:
        name, why = next(iter(refused.items()))
        raise NoAnswerError(f"merge: no walk could be added; {name} {why}")
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
    file = paths[0] / ENCODER
    return file.read_bytes() if file.is_file() else None
