"""Floor plans in use: drawn below walks, maps placed on them, walks followed through them."""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from elfslam.app.export import map_of
from elfslam.base.arrays import F64
from elfslam.base.building import Building, Passage
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.geometry import compose, wrap_angle
from elfslam.base.grid import FloorGrid, outlines, signed_area
from elfslam.base.values import FloorMap, Run, Trajectory
from elfslam.data.atomic_files import new_folder, refuse_occupied, settled
from elfslam.data.building_files import floor_folder, read_building, write_building
from elfslam.data.floor_plans import GEOJSON, IMAGES, read_plan_geojson, read_plan_image
from elfslam.data.geographic import Origin
from elfslam.data.map_exports import walk_lines
from elfslam.data.map_files import ENCODER, FACTS, MAP, read_map, write_map
from elfslam.data.position_files import write_tum
from elfslam.data.runs import read_run
from elfslam.scoring.figures import FloorPlan
from elfslam.slam.parameters import Parameters
from elfslam.stages.floor_plan_alignment import (
    NOWHERE,
    OK,
    AnchoringParameters,
    Placement,
    Tag,
    anchor,
    placed,
    standing,
)
from elfslam.stages.floormap import trajectory_map
from elfslam.stages.map_matching import (
    Followed,
    MapMatchingParameters,
    follow_ground,
    followed_trajectory,
)
from elfslam.world.room import Room
from elfslam.world.world_file import load_world

ANCHOR = "anchor.json"
WIDTH = re.compile(r"\d{1,9}(\.\d{0,9})?")


@dataclass(frozen=True, eq=False)
class Plan:
    """Accessible ground, and where on the Earth its frame lies where the file says so."""

    ground: FloorGrid
    origin: Origin | None = None


def is_plan_file(text: str) -> bool:
    """Whether a text names a plan in a file: it ends like one, or like one and what of it."""
    return _plan_file(text)[0].suffix.lower() in (*IMAGES, *GEOJSON)


def _plan_file(text: str) -> tuple[Path, str | None]:
    """The file of a plan, and the width or the level that stands behind it."""
    name, colon, told = text.rpartition(":")
    known = Path(text).suffix.lower() in (*IMAGES, *GEOJSON)
    return (Path(text), None) if known or not colon else (Path(name), told)


def read_plan(text: str) -> Plan:
    """The plan of "plan.png:24.5" (an image and its width in metres) or "plan.geojson".

    "plan.geojson:1" is its level 1. Raises InputError.
    """
    file, told = _plan_file(text)
    if file.suffix.lower() in GEOJSON:
        try:
            return Plan(*read_plan_geojson(file, level=told))
        except InputError as error:
            such = f", such as {file}:{error.choices[0]}" if error.choices else ""
            raise InputError(f"{error}{such}") from error
    if told is None or file.suffix.lower() not in IMAGES or not WIDTH.fullmatch(told):
        raise InputError(
            f"{text}: wanted an image with its width in metres, such as plan.png:24.5, "
            "or plan.geojson"
        )
    return Plan(read_plan_image(file, float(told)))


def drawn(ground: FloorGrid) -> FloorPlan:
    """A plan as it is drawn under walks: its rooms, and what stands in them."""
    polygons = sorted(outlines(ground), key=lambda polygon: -signed_area(polygon[0]))
    if not polygons:
        raise InputError("the plan has no accessible ground; walls are dark, ground is light")
    holes = tuple(hole for polygon in polygons for hole in polygon[1:])
    first, *rooms = [polygon[0] for polygon in polygons]
    return FloorPlan(first, holes, tuple(rooms))


def moved_map(floor_map: FloorMap, placement: Placement) -> FloorMap:
    """The map in the frame of the plan; covariances turn and stretch with it."""
    heading, scale = float(placement.plan_from_map[2]), placement.scale
    cos, sin = scale * np.cos(heading), scale * np.sin(heading)
    turn = np.array([[cos, -sin], [sin, cos]])
    return replace(
        floor_map,
        xy_m=placed(floor_map.xy_m, placement.plan_from_map, scale),
        heading_rad=wrap_angle(floor_map.heading_rad + heading),
        covariance_m2=turn @ floor_map.covariance_m2 @ turn.T,
    )


def place_on(
    floor_map: FloorMap, plan: Plan, parameters: AnchoringParameters, start_m: F64 | None
) -> Placement:
    """Where the map lies on the plan; `start_m` (2) is where on it the first walk began."""
    lines = walk_lines(floor_map)
    tag = None if start_m is None else Tag(lines[0][1][0], start_m)
    return anchor([line for _, line in lines], plan.ground, parameters, tag)


def anchor_into(
    out: Path, source: Path, plan: Plan, parameters: AnchoringParameters, start_m: F64 | None
) -> Placement:
    """Place a run or a map on a plan, and write it as a map folder where that is certain.

    The folder holds the map in the plan's frame, the encoder where one lies beside the map, and
    the placement. Raises StoreError where the folder is taken.
    """
    refuse_occupied(out, None)
    floor_map = map_of(settled(source))
    placement = place_on(floor_map, plan, parameters, start_m)
    if placement.status == OK:
        with new_folder(out) as partial:
            _fill_anchored(partial, source, floor_map, placement, plan)
    return placement


def _fill_anchored(
    folder: Path, source: Path, floor_map: FloorMap, placement: Placement, plan: Plan
) -> None:
    """The map in the frame of the plan, the encoder beside it, and the placement."""
    write_map(moved_map(floor_map, placement), folder / MAP)
    encoder = (source if source.is_dir() else source.parent) / ENCODER
    if encoder.is_file():
        (folder / ENCODER).write_bytes(encoder.read_bytes())
    told = json.dumps(described(placement, plan), indent=2)
    (folder / ANCHOR).write_text(told + "\n", encoding="utf-8")


def anchor_building_into(
    out: Path, source: Path, plan: str, parameters: AnchoringParameters, start_m: F64 | None
) -> Placement:
    """Place a building on a plan of its levels, all floors alike, and write it where that is sure.

    Its floors share a frame and so do the plan's: that of the most certain placement which keeps
    the other floors on their ground. Else the status says why nothing was written.
    """
    refuse_occupied(out, None)
    building = read_building(settled(source))
    floors = {level: read_map(floor_folder(source, level)) for level in building.levels}
    plans = {level: read_plan(f"{plan}:{level}") for level in floors}
    begun = {floors_first(building): start_m}
    found = {
        level: place_on(floors[level], plans[level], parameters, begun.get(level))
        for level in floors
    }
    sure = [each for each in found.values() if each.status == OK]
    if not sure:
        return next(iter(found.values()))
    off = [_off_share(each, floors, plans) for each in sure]
    best = replace(sure[int(np.argmin(off))], off_share=min(off))
    if best.off_share > parameters.most_off:
        return replace(best, status=NOWHERE)
    moved = replace(building, passages=tuple(_moved(each, best) for each in building.passages))
    with new_folder(out) as partial:
        write_building(moved, partial)
        for level, floor_map in floors.items():
            folder = floor_folder(partial, level)
            folder.mkdir(parents=True)
            _fill_anchored(folder, floor_folder(source, level), floor_map, best, plans[level])
    return best


def floors_first(building: Building) -> int:
    """The level on which a walk began: 0, or the lowest without it."""
    return 0 if 0 in building.levels else building.levels[0]


def _off_share(
    placement: Placement, floors: Mapping[int, FloorMap], plans: Mapping[int, Plan]
) -> float:
    """The largest share of a floor's spots that a placement puts off its ground."""
    return max(
        1 - float(plans[level].ground.holds(moved_map(each, placement).xy_m).mean())
        for level, each in floors.items()
    )


def _moved(passage: Passage, placement: Placement) -> Passage:
    ends_m = np.array([passage.from_xy_m, passage.to_xy_m])
    left, reached = placed(ends_m, placement.plan_from_map, placement.scale).tolist()
    return replace(passage, from_xy_m=tuple(left), to_xy_m=tuple(reached))


def described(placement: Placement, plan: Plan) -> dict[str, object]:
    """A placement as plain values."""
    return {
        "status": placement.status,
        "plan_from_map": placement.plan_from_map.tolist(),
        "scale": placement.scale,
        "covariance": placement.covariance.tolist(),
        "shares": placement.shares.tolist(),
        "others": placement.others.tolist(),
        "off_share": placement.off_share,
        "origin": None if plan.origin is None else asdict(plan.origin),
    }


def drawn_plan(plan: str | None) -> FloorPlan | None:
    """The plan that is to be drawn below, if one is: of a file, or of a world."""
    if plan is not None and is_plan_file(plan):
        return drawn(read_plan(plan).ground)
    return None if plan is None else floor_plan(load_world(plan).room)


def floor_plan(room: Room) -> FloorPlan:
    """A simulated room as it is drawn under walks."""
    return FloorPlan(room.outline_m, tuple(block.corners_m for block in room.blocks))


FOLLOWED = "followed.tum"
SEED = 0


@dataclass(frozen=True, eq=False)
class Start:
    """Where a walk begins on a plan (x, y, heading), how certain that is (3, 3), and its scale."""

    pose: F64
    covariance: F64
    scale: float = 1.0


def start_on(placement: Placement, lines_m: list[F64], run: Run) -> Start:
    """Where a placed run begins on the plan, as uncertain as its placement."""
    first = run.trajectory.world_from_body[0]
    scaled = first * [placement.scale, placement.scale, 1.0]
    pose = compose(placement.plan_from_map, scaled)
    points = np.concatenate(lines_m)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    away = pose[:2] - placed(middle[None, :], placement.plan_from_map, placement.scale)[0]
    carried = np.eye(3)
    carried[:2, 2] = -away[1], away[0]
    return Start(pose, carried @ placement.covariance @ carried.T, placement.scale)


def follow(
    run: Run, start: Start, ground: FloorGrid, keep_off_m: float, parameters: MapMatchingParameters
) -> Followed:
    """The walk of a run through the passages of a plan; its covariance is of the plan's frame.

    Raises NoAnswerError where there is no ground, or the walk cannot keep to it.
    """
    open_ground = standing(ground, keep_off_m)
    if not open_ground.free.any():
        raise NoAnswerError(
            f"the plan has no ground {keep_off_m:g} m off its walls; lower anchoring.keep_off_m"
        )
    poses = run.trajectory.world_from_body * [start.scale, start.scale, 1.0]
    straightened = replace(run.odometry, world_from_body=poses)
    generator = np.random.default_rng(SEED)
    return follow_ground(
        straightened, start.pose, start.covariance, open_ground, parameters, generator
    )


def follow_into(
    out: Path,
    source: Path,
    plan: Plan,
    settings: tuple[AnchoringParameters, MapMatchingParameters],
    start: Start | None,
) -> Followed:
    """Bend a run through the passages of a plan, and write it as a map folder in its frame.

    From `start`, or from where `anchor` places it. Raises NoAnswerError where it cannot be placed
    or followed (nothing is written then), InputError where the source is no run.
    """
    anchoring, map_matching = settings
    refuse_occupied(out, None)
    if not (settled(source) / FACTS).is_file():
        raise InputError(f"{source}: is no run; only a walk with its footsteps can be followed")
    run = read_run(source)
    if start is None:
        lines = [line for _, line in walk_lines(map_of(source))]
        placement = anchor(lines, plan.ground, anchoring)
        if placement.status != OK:
            raise NoAnswerError(
                f"{source}: its place on the plan is {placement.status}; "
                "say where it begins, as X,Y,HEADING",
                argument="start",
            )
        start = start_on(placement, lines, run)
    followed = follow(run, start, plan.ground, anchoring.keep_off_m, map_matching)
    if followed.off_share > anchoring.most_off:
        raise NoAnswerError(
            f"{source}: {followed.off_share:.0%} of it leaves the ground of the plan whichever way "
            "it went; is it that floor, and is the start right?"
        )
    trajectory = followed_trajectory(run.trajectory, followed)
    with new_folder(out) as partial:
        write_map(_map_along(run, trajectory, map_of(source)), partial / MAP)
        write_tum(partial / FOLLOWED, trajectory.t_s, trajectory.world_from_body)
        if (source / ENCODER).is_file():
            (partial / ENCODER).write_bytes((source / ENCODER).read_bytes())
    return followed


def _map_along(run: Run, trajectory: Trajectory, known: FloorMap) -> FloorMap:
    """The map of a run, its spots where the followed walk passes them."""
    if run.features is None or run.floor_map is None:
        poses = trajectory.world_from_body
        covariance = trajectory.covariance[:, :2, :2]
        return replace(known, xy_m=poses[:, :2], heading_rad=poses[:, 2], covariance_m2=covariance)
    made = trajectory_map(
        trajectory,
        run.features,
        Parameters().floormap,
        parameters_digest=known.parameters_digest,
        source=run.name,
    )
    return replace(
        known, xy_m=made.xy_m, heading_rad=made.heading_rad, covariance_m2=made.covariance_m2
    )
