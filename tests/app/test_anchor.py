"""Maps placed on plans from files, and plans drawn."""

import dataclasses
import itertools
import json
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from PIL import Image

from elfslam.app import anchor
from elfslam.app.export import ExportContext, export
from elfslam.base import values
from elfslam.base.building import Building, BuildingFloor, Passage
from elfslam.base.enums import Format
from elfslam.base.errors import InputError, NoAnswerError, StoreError
from elfslam.base.geometry import chain, inverse
from elfslam.base.grid import FloorGrid, outlines, walked_grid
from elfslam.base.values import NO_CLOSURES, FloorMap, LevelPassage, Odometry, Run, Trajectory
from elfslam.cli import app as command
from elfslam.data.building_files import floor_folder, read_building, write_building
from elfslam.data.geographic import Origin, from_lon_lat, to_lon_lat
from elfslam.data.imdf import Venue
from elfslam.data.map_exports import feature, polygon_of
from elfslam.data.map_files import read_map, write_map
from elfslam.data.runs import write_run
from elfslam.stages import floor_plan_alignment
from elfslam.stages.floor_plan_alignment import NOWHERE, OK, AnchoringParameters, Placement, placed
from elfslam.stages.map_matching import MapMatchingParameters

KNOWN = AnchoringParameters(cell_m=0.15)
WALK = np.array([[1, 1], [11, 1], [11, 5], [7, 5], [7, 8.0]])
PLAN_FROM_MAP = np.array([3.0, -2.0, 2.1])


@pytest.fixture
def image(tmp_path: Path) -> str:
    """A corridor about the walk as an image of 14 m; its origin is the plan's."""
    grid = walked_grid([WALK], 0.7, 0.1)
    pixels = np.zeros((100, 140), dtype=np.uint8)
    row, column = np.round(grid.corner_m[::-1] / 0.1).astype(int)
    rows, columns = grid.free.shape
    pixels[row : row + rows, column : column + columns] = 255 * grid.free
    Image.fromarray(pixels[::-1]).save(tmp_path / "plan.png")
    return f"{tmp_path / 'plan.png'}:14"


def spots(line_m: np.ndarray) -> FloorMap:
    """The map of a walk along a line of the plan."""
    xy_m = placed(line_m, inverse(PLAN_FROM_MAP), 1.0)
    dense = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(xy_m)])
    count = len(dense)
    covariance = np.tile(np.diag([0.04, 0.01]), (count, 1, 1))
    walk = np.zeros(count, dtype=int)
    return FloorMap(dense, np.zeros(count), walk, np.arange(count), covariance, (), "", ("a",))


@pytest.fixture
def floor_map() -> FloorMap:
    return spots(WALK)


def test_maps_are_written_in_plan_frames(image: str, floor_map: FloorMap, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    write_map(floor_map, tmp_path / "run" / "map.npz")
    (tmp_path / "run" / "encoder.onnx").write_bytes(b"encoder")
    found = anchor.anchor_into(
        tmp_path / "out", tmp_path / "run", anchor.read_plan(image), KNOWN, None
    )
    assert found.status == OK
    there = read_map(tmp_path / "out")
    truth = placed(floor_map.xy_m, PLAN_FROM_MAP, 1.0)
    assert np.linalg.norm(there.xy_m - truth, axis=1).max() < 0.4
    assert (tmp_path / "out" / "encoder.onnx").read_bytes() == b"encoder"
    told = json.loads((tmp_path / "out" / "anchor.json").read_text())
    assert told["status"] == OK
    npt.assert_allclose(told["plan_from_map"], found.plan_from_map)
    with pytest.raises(StoreError, match="already exists"):
        anchor.anchor_into(tmp_path / "out", tmp_path / "run", anchor.read_plan(image), KNOWN, None)


def test_what_is_uncertain_is_not_written(image: str, floor_map: FloorMap, tmp_path: Path) -> None:
    part = FloorMap(
        *(getattr(floor_map, name)[:10] for name in ("xy_m", "heading_rad", "walk", "order")),
        floor_map.covariance_m2[:10], (), "", (),
    )  # fmt: skip
    write_map(part, tmp_path / "map.npz")
    found = anchor.anchor_into(
        tmp_path / "out", tmp_path / "map.npz", anchor.read_plan(image), KNOWN, None
    )
    assert found.status == floor_plan_alignment.AMBIGUOUS
    assert not (tmp_path / "out").exists()


def test_headings_and_covariances_turn_with_the_map(image: str, floor_map: FloorMap) -> None:
    found = anchor.place_on(floor_map, anchor.read_plan(image), KNOWN, None)
    moved = anchor.moved_map(floor_map, found)
    heading = found.plan_from_map[2]
    npt.assert_allclose(np.exp(1j * moved.heading_rad), np.exp(1j * heading))
    ahead = np.array([np.cos(heading), np.sin(heading)])
    npt.assert_allclose(ahead @ moved.covariance_m2[0] @ ahead, 0.04 * found.scale**2)


def test_a_start_is_of_the_first_walk(image: str, floor_map: FloorMap) -> None:
    found = anchor.place_on(floor_map, anchor.read_plan(image), KNOWN, WALK[0])
    assert found.status == OK
    assert np.linalg.norm(placed(floor_map.xy_m[:1], found.plan_from_map, 1.0) - WALK[0]) < 0.5


def test_a_map_lies_where_it_is_on_its_own_export(floor_map: FloorMap, tmp_path: Path) -> None:
    venue = Venue("Tower", "hotel", "Hauptstrasse 1", "Bern", "CH", "Ground", 0)
    told = ExportContext(Origin(47.0, 8.0), venue)
    (tmp_path / "map").mkdir()
    write_map(floor_map, tmp_path / "map" / "map.npz")
    export(tmp_path / "map", tmp_path / "own.zip", Format.IMDF, told)
    plan = anchor.read_plan(str(tmp_path / "own.zip"))
    found = anchor.place_on(floor_map, plan, KNOWN, None)
    assert found.status == OK
    assert abs(found.plan_from_map[2]) < 0.05
    assert plan.origin is not None
    there = to_lon_lat(plan.origin, placed(floor_map.xy_m, found.plan_from_map, found.scale))
    npt.assert_allclose(there, to_lon_lat(told.origin, floor_map.xy_m), atol=5e-6)


def test_a_plan_in_degrees_says_where_its_frame_lies(tmp_path: Path) -> None:
    there = Origin(47.3769, 8.5417, 90.0)
    ring = np.array([[0, 0], [6, 0], [6, 4], [0, 4]], dtype=float)
    file = tmp_path / "plan.geojson"
    file.write_text(json.dumps(feature(polygon_of(there, (ring,)), {})))
    plan = anchor.read_plan(str(file))
    middle = np.array([[plan.origin.longitude_deg, plan.origin.latitude_deg]])
    npt.assert_allclose(from_lon_lat(there, middle), [[3, 2]], atol=0.02)
    assert len(anchor.drawn(plan.ground).outline) >= 4


def test_rooms_and_what_stands_in_them_are_drawn(tmp_path: Path) -> None:
    pixels = np.full((40, 60), 255, dtype=np.uint8)
    pixels[:, 40] = 0
    pixels[10:20, 10:20] = 0
    Image.fromarray(pixels).save(tmp_path / "plan.png")
    plan = anchor.drawn(anchor.read_plan(f"{tmp_path / 'plan.png'}:6.0").ground)
    assert np.ptp(plan.outline, axis=0) == pytest.approx([4, 4], abs=0.1)
    assert [np.ptp(ring, axis=0) for ring in plan.rooms] == [pytest.approx([1.9, 4.0], abs=0.1)]
    assert [ring.mean(axis=0) for ring in plan.obstacles] == [pytest.approx([1.5, 2.5], abs=0.1)]


@pytest.mark.parametrize("text", ["plan.png", "plan.png:wide", "plan.png:1.2.3", "plan.doc:12"])
def test_an_image_needs_its_width(text: str) -> None:
    with pytest.raises(InputError, match=r"metre|as an image"):
        anchor.read_plan(text)


def test_a_level_of_a_plan_stands_behind_its_file(tmp_path: Path) -> None:
    rooms = []
    for level, side_m in (("0", 6.0), ("1", 9.0)):
        ring = [[0, 0], [side_m, 0], [side_m, 4], [0, 4], [0, 0]]
        rooms.append(feature({"type": "Polygon", "coordinates": [ring]}, {"level": level}))
    file = tmp_path / "plan.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": rooms}))
    plans = [anchor.drawn(anchor.read_plan(f"{file}:{k}").ground) for k in (0, 1)]
    widths_m = [np.ptp(plan.outline[:, 0]) for plan in plans]
    assert widths_m == pytest.approx([6.0, 9.0], abs=0.2)
    for text, said in (
        (f"{file}", "has the levels 0, 1; choose one, such as"),
        (f"{file}:2", "has no level '2', wanted one of 0, 1, such as"),
    ):
        with pytest.raises(InputError, match=said) as refused:
            anchor.drawn_plan(text)
        assert str(refused.value).endswith(f", such as {file}:0")


def test_files_are_told_from_worlds() -> None:
    named = ["studio", "a/plan.png:12", "a/plan.PNG", "plan.geojson", "p.json:-1", "my.toml"]
    assert [anchor.is_plan_file(text) for text in named] == [False, True, True, True, True, False]


FOLLOW_KNOWN = MapMatchingParameters(particles=300)
HALL = FloorGrid(np.ones((300, 300), dtype=bool), np.array([-15.0, -15.0]), 0.1)


@pytest.fixture
def run() -> Run:
    """Ten metres straight ahead, by steps alone."""
    poses = chain(np.array([1.0, 0.0, 0.0]), np.tile([0.5, 0.0, 0.0], (20, 1)))
    t_s = 0.5 * np.arange(len(poses))
    nodes = Odometry(t_s, poses, np.tile([0.1, 0.1, 0.01], (20, 1)))
    spread = np.tile(0.01 * np.eye(3), (len(poses), 1, 1))
    walk = Trajectory(t_s, poses, spread, np.zeros(0), "NO_CLOSURES")
    alike = values.MeanSimilarity(np.zeros((20, 1), dtype=np.float32), kind="motion")
    return Run("walk", nodes, alike, NO_CLOSURES, walk, None, None, None)


def placement() -> Placement:
    one = np.ones(1)
    covariance = np.diag([0.04, 0.04, 0.01])
    pose = np.array([2.0, 3.0, np.pi / 2])
    return Placement(pose, covariance, one, np.zeros((0, 3)), 1.0, 0.0, OK)


def test_a_placed_run_begins_where_its_first_pose_lies_on_the_plan(run: Run) -> None:
    start = anchor.start_on(placement(), [run.trajectory.world_from_body[:, :2]], run)
    npt.assert_allclose(start.pose, [2.0, 4.0, np.pi / 2])
    # Five metres of lever to the walk's middle, straight behind it.
    npt.assert_allclose(np.diag(start.covariance), [0.04 + 0.01 * 25, 0.04, 0.01])


def test_lengths_follow_the_scale_of_the_placement(run: Run) -> None:
    double = dataclasses.replace(placement(), scale=2.0)
    start = anchor.start_on(double, [run.trajectory.world_from_body[:, :2]], run)
    npt.assert_allclose(start.pose, [2.0, 5.0, np.pi / 2])
    found = anchor.follow(run, start, HALL, 0.4, FOLLOW_KNOWN)
    assert np.linalg.norm(found.poses[10, :2] - found.poses[0, :2]) == pytest.approx(10, abs=0.7)


def test_a_walk_is_followed_from_its_start(run: Run) -> None:
    start = anchor.Start(np.array([-5.0, 1.0, 0.0]), np.diag([0.01, 0.01, 1e-4]))
    found = anchor.follow(run, start, HALL, 0.4, FOLLOW_KNOWN)
    npt.assert_allclose(found.poses[-1], [5.0, 1.0, 0.0], atol=0.5)


def test_a_plan_without_room_to_stand_is_refused(run: Run) -> None:
    narrow = walked_grid([np.array([[0, 0], [9, 0.0]])], 0.3, 0.1)
    start = anchor.Start(np.zeros(3), np.eye(3))
    with pytest.raises(NoAnswerError, match=r"lower anchoring\.keep_off_m"):
        anchor.follow(run, start, narrow, 0.4, FOLLOW_KNOWN)


def test_a_walk_that_fits_in_several_ways_needs_its_start_said(run: Run, tmp_path: Path) -> None:
    write_run(run, tmp_path / "run", facts={}, encoder=None)
    quick = AnchoringParameters(cell_m=0.5)
    how = (quick, FOLLOW_KNOWN), None
    with pytest.raises(NoAnswerError, match="AMBIGUOUS; say where it begins"):
        anchor.follow_into(tmp_path / "out", tmp_path / "run", anchor.Plan(HALL), *how)
    assert not (tmp_path / "out").exists()


UPSTAIRS = np.array([[1, 1], [1, 8], [4, 8], [4, 3], [11, 3.0]])


def tower(folder: Path) -> Path:
    """Two floors in one frame, and stairs at the end of the lower one."""
    stairs_m = placed(WALK[-1:], inverse(PLAN_FROM_MAP), 1.0)[0].tolist()
    stairs = Passage(LevelPassage.STAIRS, 0, 1, tuple(stairs_m), tuple(stairs_m), 20.0)
    folder.mkdir()
    floors = (BuildingFloor(0, 0.0), BuildingFloor(1, 3.5))
    write_building(Building("tower", floors, (stairs,)), folder)
    for level, line_m in enumerate([WALK, UPSTAIRS]):
        floor_folder(folder, level).mkdir(parents=True)
        write_map(spots(line_m), floor_folder(folder, level) / "map.npz")
    return folder


def plan_of(file: Path, *lines_m: np.ndarray) -> str:
    """Corridors about a line on each level, as Simple Indoor Tagging has them."""
    corridors = [
        feature(
            {
                "type": "Polygon",
                "coordinates": [[*part.tolist(), part[0].tolist()] for part in ring],
            },
            {"level": str(level)},
        )
        for level, line_m in enumerate(lines_m)
        for ring in outlines(walked_grid([line_m], 0.7, 0.1))
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": corridors}))
    return str(file)


def test_all_floors_of_a_building_are_laid_on_the_levels_of_a_plan_at_once(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "plan.geojson", WALK, UPSTAIRS)
    out = tmp_path / "out"
    assert command.run(["anchor", str(tower(tmp_path / "tower")), plan, str(out)]) == 0
    for level, line_m in enumerate([WALK, UPSTAIRS]):
        there = read_map(floor_folder(out, level))
        truth = placed(spots(line_m).xy_m, PLAN_FROM_MAP, 1.0)
        assert np.linalg.norm(there.xy_m - truth, axis=1).max() < 0.4
    (stairs,) = read_building(out).passages
    npt.assert_allclose(stairs.from_xy_m, WALK[-1], atol=0.4)


def test_a_building_whose_other_floor_leaves_its_ground_is_not_laid(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "plan.geojson", WALK, WALK[:3])
    building = tower(tmp_path / "tower")
    found = anchor.anchor_building_into(tmp_path / "out", building, plan, KNOWN, None)
    assert found.status == NOWHERE
    assert not (tmp_path / "out").exists()
