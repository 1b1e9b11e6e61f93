"""Maps as GeoJSON: what another reader finds is what the map says; metres and degrees."""

import json
from pathlib import Path

import gtsam
import numpy as np
import numpy.testing as npt
import pytest
import shapely
from pyarrow import parquet
from shapely.geometry import shape

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.geometry import between
from elfslam.base.grid import FloorGrid, walked_grid
from elfslam.base.values import FloorMap, Payload, PointKind, PointOfInterest, PoseGraph
from elfslam.data import map_exports
from elfslam.data.geographic import Origin, bearings_deg, from_lon_lat, parse_origin, to_lon_lat

ORIGIN = Origin(47.3769, 8.5417, 30.0)


@pytest.fixture
def floor_map() -> FloorMap:
    """Two walks, the second one with a gap, its spots out of order."""
    xy_m = np.array([[0, 0], [1, 0], [2, 0], [9, 1], [0, 1], [1, 1], [8, 1]], dtype=float)
    walk, order = np.array([0, 0, 0, 1, 1, 1, 1]), np.array([0, 1, 2, 3, 0, 1, 2])
    covariance = np.tile(np.diag([0.04, 0.0]), (7, 1, 1))
    heading = np.linspace(0, 3, 7)
    return FloorMap(xy_m, heading, walk, order, covariance, (), "", ("first", "second"))


def read(file: Path, kind: str) -> list[dict[str, object]]:
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["type"] == "FeatureCollection"
    assert "crs" not in content, "RFC 7946 knows WGS84 alone"
    return [each for each in content["features"] if each["properties"]["kind"] == kind]


def test_walks_spots_and_cells_lie_as_in_the_map(floor_map: FloorMap, tmp_path: Path) -> None:
    ring = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    features = map_exports.map_features(floor_map, ORIGIN, [(ring, {"kind": "coverage"})])
    map_exports.write_geojson(tmp_path / "m.geojson", features)
    spots = read(tmp_path / "m.geojson", "spot")
    points = shapely.get_coordinates([shape(each["geometry"]) for each in spots])
    npt.assert_allclose(from_lon_lat(ORIGIN, points), floor_map.xy_m, atol=1e-3)
    told = [each["properties"] for each in spots]
    assert [each["walk"] for each in told] == floor_map.walk.tolist()
    assert told[0]["sigma_m"] == pytest.approx(np.sqrt(0.02), abs=1e-4)
    assert told[0]["bearing_deg"] == 30.0
    walks = read(tmp_path / "m.geojson", "walk")
    assert [each["geometry"]["type"] for each in walks] == ["LineString"] * 3
    assert [each["properties"]["source"] for each in walks] == ["first", "second", "second"]
    (cell,) = read(tmp_path / "m.geojson", "coverage")
    polygon = shape(cell["geometry"])
    assert polygon.is_valid
    assert polygon.exterior.is_ccw


def test_points_of_interest_are_points_with_a_name(floor_map: FloorMap, tmp_path: Path) -> None:
    door = PointOfInterest("Tür 5", PointKind.DOOR, 1.5, -2.0)
    features = map_exports.map_features(floor_map, ORIGIN, points_of_interest=[door])
    map_exports.write_geojson(tmp_path / "m.geojson", features)
    (told,) = read(tmp_path / "m.geojson", "point_of_interest")
    assert told["properties"] == {"kind": "point_of_interest", "name": "Tür 5", "category": "door"}
    place = shapely.get_coordinates(shape(told["geometry"]))
    npt.assert_allclose(from_lon_lat(ORIGIN, place), [[1.5, -2.0]], atol=1e-3)


def test_walks_are_ordered_and_cut_at_gaps(floor_map: FloorMap) -> None:
    lines = map_exports.walk_lines(floor_map)
    assert [walk for walk, _ in lines] == [0, 1, 1]
    npt.assert_allclose(lines[1][1], [[0, 1], [1, 1]])
    npt.assert_allclose(lines[2][1], [[8, 1], [9, 1]])


RANDOM = np.random.default_rng(5)
PAYLOAD = Payload("elf", "compact", RANDOM.normal(size=(4, 3)).astype(np.float32))
MAP = FloorMap(
    RANDOM.normal(size=(4, 2)),
    RANDOM.normal(size=4),
    np.array([0, 0, 1, 1]),
    np.array([0, 1, 0, 1]),
    np.array([[[2.0, 0.5], [0.5, 1.0]], [[1.0, -0.3], [-0.3, 4.0]], np.eye(2), 0.1 * np.eye(2)]),
    (PAYLOAD,),
    "abc",
    ("Zürich", "b"),
)


def test_every_spot_is_a_row(tmp_path: Path) -> None:
    map_exports.write_parquet(tmp_path / "spots.parquet", MAP)
    table = parquet.read_table(tmp_path / "spots.parquet")
    rows = table.to_pylist()
    npt.assert_array_equal([[row["x_m"], row["y_m"]] for row in rows], MAP.xy_m)
    npt.assert_array_equal([row["heading_rad"] for row in rows], MAP.heading_rad)
    assert [(row["walk"], row["order"]) for row in rows] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    npt.assert_array_equal([row["covariance_xy_m2"] for row in rows], MAP.covariance_m2[:, 0, 1])
    npt.assert_array_equal([row["covariance_yy_m2"] for row in rows], MAP.covariance_m2[:, 1, 1])
    npt.assert_array_equal(np.array([row["elf"] for row in rows], np.float32), PAYLOAD.vectors)
    told = table.schema.metadata
    assert json.loads(told[b"sources"]) == ["Zürich", "b"]
    assert json.loads(told[b"encoders"]) == {"elf": "compact"}


def served(file: Path, xy_m: F64) -> list[str]:
    """What map_server says of points: trinary mode, the image's first row on top."""
    told = dict(line.split(": ", 1) for line in file.read_text().splitlines())
    assert told["negate"] == "0"
    image = (file.parent / told["image"].strip('"')).read_bytes()
    magic, size, top, pixels = image.split(b"\n", 3)
    assert (magic, top) == (b"P5", b"255")
    columns, rows = map(int, size.split())
    grid = np.frombuffer(pixels, dtype=np.uint8).reshape(rows, columns)
    origin = [float(cell) for cell in told["origin"].strip("[]").split(",")]
    assert origin[2] == 0.0
    at = np.floor((xy_m - origin[:2]) / float(told["resolution"])).astype(int)
    occupied = (255 - grid[rows - 1 - at[:, 1], at[:, 0]]) / 255.0
    return [
        "occupied"
        if p > float(told["occupied_thresh"])
        else "free"
        if p < float(told["free_thresh"])
        else "unknown"
        for p in occupied
    ]


def written(file: Path, grid: FloorGrid) -> None:
    """The files of a ROS map."""
    image = map_exports.image_beside(file)
    text, content = map_exports.ros_map(grid, image.name)
    file.write_text(text, encoding="utf-8")
    image.write_bytes(content)


def test_walked_ground_is_free_and_the_rest_unknown(tmp_path: Path) -> None:
    line = np.array([[-1.0, 2.0], [3.0, 2.0], [3.0, 7.0]])
    written(tmp_path / "floor.yaml", walked_grid([line], 0.25, 0.05))
    beside = line + np.array([[0.0, 0.2], [0.2, 0.0], [-0.2, 0.0]])
    assert served(tmp_path / "floor.yaml", np.vstack([line, beside])) == ["free"] * 6
    off = np.array([[1.0, 2.35], [0.0, 5.0], [3.28, 7.0]])
    assert served(tmp_path / "floor.yaml", off) == ["unknown"] * 3


def test_every_square_comes_back(tmp_path: Path) -> None:
    free = np.random.default_rng(3).random((7, 4)) < 0.5
    written(tmp_path / "m.yml", FloorGrid(free, np.array([-3.2, 1.6]), 0.4))
    x, y = np.meshgrid(-3.2 + 0.4 * (np.arange(4) + 0.5), 1.6 + 0.4 * (np.arange(7) + 0.5))
    said = served(tmp_path / "m.yml", np.column_stack([x.ravel(), y.ravel()]))
    npt.assert_array_equal(np.array(said).reshape(7, 4) == "free", free)
    assert set(said) == {"free", "unknown"}


def test_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.yaml"):
        map_exports.image_beside(tmp_path / "m.pgm")


INFORMATION = "400 1 2 300 3 100"
GRAPH = f"""VERTEX_SE2 10 1 2 0.5
VERTEX_SE2 30 2 2 0.5
# a remark

FIX 10
VERTEX_SE2 20 1.5 2 0.5
EDGE_SE2 10 20 0.5 0 0 {INFORMATION}
EDGE_SE2 20 30 0.5 0.1 0 {INFORMATION}
EDGE_SE2 10 20 0.6 0 0 {INFORMATION}
EDGE_SE2 30 10 -1 0 0.1 {INFORMATION}
"""


def written_g2o(folder: Path, text: str) -> Path:
    file = folder / "graph.g2o"
    file.write_text(text)
    return file


def random_graph(generator: np.random.Generator) -> PoseGraph:
    root = generator.normal(size=(5, 3, 3))
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
    information = root @ np.swapaxes(root, 1, 2) + np.eye(3)
    information = (information + np.swapaxes(information, 1, 2)) / 2
    poses = generator.normal(size=(4, 3)) * [100.0, 100.0, 1.0]
    measurements = between(poses[edges[:, 0]], poses[edges[:, 1]])
    return PoseGraph(poses, edges, measurements, information, np.arange(5) >= 3)


def assert_same(one: PoseGraph, other: PoseGraph) -> None:
    for name in ("initial", "edges", "measurements", "information", "is_closure"):
        npt.assert_array_equal(getattr(one, name), getattr(other, name))


def test_what_the_rows_say(tmp_path: Path) -> None:
    graph = map_exports.read_g2o(written_g2o(tmp_path, GRAPH))
    npt.assert_array_equal(graph.initial, [[1, 2, 0.5], [1.5, 2, 0.5], [2, 2, 0.5]])
    npt.assert_array_equal(graph.edges, [[0, 1], [1, 2], [0, 1], [2, 0]])
    npt.assert_array_equal(graph.measurements[3], [-1, 0, 0.1])
    npt.assert_array_equal(graph.information[0], [[400, 1, 2], [1, 300, 3], [2, 3, 100]])
    npt.assert_array_equal(graph.is_closure, [False, False, True, True])


def test_every_bit_comes_back(tmp_path: Path) -> None:
    graph = random_graph(np.random.default_rng(0))
    map_exports.write_g2o(tmp_path / "a.g2o", graph)
    assert_same(map_exports.read_g2o(tmp_path / "a.g2o"), graph)


def test_solved_poses_can_stand_in_for_the_initial_ones(tmp_path: Path) -> None:
    graph = random_graph(np.random.default_rng(1))
    map_exports.write_g2o(tmp_path / "a.g2o", graph, graph.initial + 1.0)
    npt.assert_array_equal(map_exports.read_g2o(tmp_path / "a.g2o").initial, graph.initial + 1.0)
    with pytest.raises(InputError, match="got 3 poses for a graph of 4"):
        map_exports.write_g2o(tmp_path / "a.g2o", graph, graph.initial[:3])


def test_gtsam_reads_the_same_graph(tmp_path: Path) -> None:
    graph = random_graph(np.random.default_rng(2))
    map_exports.write_g2o(tmp_path / "a.g2o", graph)
    problem, values = gtsam.readG2o(str(tmp_path / "a.g2o"), False)
    assert problem.size() == len(graph.edges)
    for k, pose in enumerate(graph.initial):
        theirs = values.atPose2(k)
        npt.assert_allclose(between(pose, [theirs.x(), theirs.y(), theirs.theta()]), 0, atol=1e-12)
    for k, information in enumerate(graph.information):
        noise = problem.at(k).noiseModel()
        npt.assert_allclose(noise.R().T @ noise.R(), information, rtol=1e-9, atol=1e-9)
    assert problem.error(values) == pytest.approx(0.0, abs=1e-18)


def test_poses_are_chained_where_only_edges_are_given(tmp_path: Path) -> None:
    lines = [line for line in GRAPH.splitlines() if "VERTEX" not in line]
    graph = map_exports.read_g2o(written_g2o(tmp_path, "\n".join(lines)))
    npt.assert_allclose(graph.initial, [[0, 0, 0], [0.5, 0, 0], [1.0, 0.1, 0]])


@pytest.mark.parametrize("name", ["intel", "manhattan", "MIT", "ringCity"])
def test_published_graphs_come_back(shared_data: Path, tmp_path: Path, name: str) -> None:
    graph = map_exports.read_g2o(shared_data / "pose_graphs" / f"{name}.g2o")
    assert (~graph.is_closure).sum() == len(graph.initial) - 1
    map_exports.write_g2o(tmp_path / "a.g2o", graph)
    assert_same(map_exports.read_g2o(tmp_path / "a.g2o"), graph)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("0.5 0.1", "0.5 x"), r"row 8 has 'x', wanted a finite number; repair that row"),
        (("0.5 0.1", "0.5 nan"), "row 8 has 'nan'"),
        (("EDGE_SE2 20 30 0.5", "EDGE_SE2 20 30"), "row 8 has 10 numbers after EDGE_SE2, wanted 1"),
        (("EDGE_SE2 30 10", "EDGE_SE2 31 10"), "row 10 joins 31 and 10, wanted two ids that have"),
        (("EDGE_SE2 30 10", "EDGE_SE2 30 30"), "row 10 joins 30 and 30"),
        (("VERTEX_SE2 20", "VERTEX_SE2 30"), "VERTEX_SE2 rows share an id; remove the repeated"),
        (("VERTEX_SE2 10", "VERTEX_SE3:QUAT 10"), "row 1 is VERTEX_SE3:QUAT, of a graph in space"),
        (("FIX 10", "VERTEX_XY 3 1 1"), "row 5 is VERTEX_XY, wanted VERTEX_SE2 or EDGE_SE2; rem"),
        (("0.1 400", "0.1 -400"), "row 10 has an information matrix that is not positive definite"),
    ],
)
def test_damage_is_named(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    assert change[0] in GRAPH
    with pytest.raises(InputError, match=says) as refused:
        map_exports.read_g2o(written_g2o(tmp_path, GRAPH.replace(*change)))
    assert "\n" not in str(refused.value)


def test_files_that_hold_no_walk_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no EDGE_SE2 row"):
        map_exports.read_g2o(written_g2o(tmp_path, "VERTEX_SE2 0 0 0 0\n"))
    backward = f"EDGE_SE2 5 1 1 0 0 {INFORMATION}"
    with pytest.raises(InputError, match="no VERTEX_SE2 rows and no EDGE_SE2 from 1 to 5; add"):
        map_exports.read_g2o(written_g2o(tmp_path, backward))
    with pytest.raises(InputError, match="cannot be read"):
        map_exports.read_g2o(tmp_path / "absent.g2o")


ZURICH = Origin(47.3769, 8.5417, 90.0)


@pytest.mark.parametrize(
    "origin", [ZURICH, Origin(-33.9, 151.2, 17.0), Origin(70.0, 179.9999, 250)]
)
def test_a_kilometre_comes_back_to_a_millimetre(origin: Origin) -> None:
    xy_m = np.random.default_rng(0).uniform(-1000, 1000, (200, 2))
    npt.assert_allclose(from_lon_lat(origin, to_lon_lat(origin, xy_m)), xy_m, atol=1e-3)


def test_a_degree_is_as_long_as_wgs84_says() -> None:
    """A second of latitude at the equator is 30.715 m, of longitude 30.922 m."""
    degrees = to_lon_lat(Origin(0.0, 0.0), np.array([[30.922, 0.0], [0.0, 30.715]]))
    npt.assert_allclose(degrees * 3600, [[1.0, 0.0], [0.0, 1.0]], atol=1e-4)


def test_the_bearing_turns_the_x_axis() -> None:
    north = to_lon_lat(Origin(47.0, 8.0, 0.0), np.array([[100.0, 0.0], [0.0, 100.0]]))
    assert north[0, 1] > 47.0008 > north[1, 1]
    assert north[1, 0] < 7.9987, "left of north is west"
    npt.assert_allclose(bearings_deg(ZURICH, np.array([0.0, np.pi / 2, np.pi])), [90, 0, 270])


@pytest.mark.parametrize("text", ["", "47", "47,8,9,10", "north,8", "91,0", "0,181", "nan,0"])
def test_what_is_no_origin_is_refused(text: str) -> None:
    with pytest.raises(ParameterError, match="origin"):
        parse_origin(text)


def test_an_origin_points_east_unless_told() -> None:
    assert parse_origin("47.3769,8.5417") == ZURICH
    assert parse_origin("47.3769, 8.5417, 12") == Origin(47.3769, 8.5417, 12.0)
