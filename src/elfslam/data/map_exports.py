"""Maps and graphs for other programs: GeoJSON (RFC 7946), Parquet, ROS map_server, g2o.

map_server: http://wiki.ros.org/map_server (nav2_map_server reads the same). The image's first row
is the highest y; `origin` is the pose of its lower left corner. A pixel of value v is occupied with
probability (255 - v) / 255: free below `free_thresh`, unknown between the two.
g2o: Kuemmerle et al. 2011, "g2o: a general framework for graph optimization". Rows
`VERTEX_SE2 id x y heading` and `EDGE_SE2 i j x y heading`, then the upper triangle of the
information matrix. `FIX` rows are skipped: the first pose is held anyway.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.building import Passage
from elfslam.base.errors import InputError
from elfslam.base.geometry import chain
from elfslam.base.grid import FloorGrid, Polygon
from elfslam.base.values import FloorMap, PointOfInterest, PoseGraph
from elfslam.data.geographic import Origin, bearings_deg, to_lon_lat
from elfslam.data.tables import number_or_nan, read_lines

DIGITS = 9
"""Of a degree: a tenth of a millimetre."""
GAP_M = 2.0
"""Spots of one walk further apart than this are not joined: between them nothing is known."""

Feature = dict[str, Any]


def walk_lines(floor_map: FloorMap) -> list[tuple[int, F64]]:
    """The lines (n, 2) of each walk in their order, cut where spots lie far apart."""
    found = []
    for walk in np.unique(floor_map.walk):
        rows = np.flatnonzero(floor_map.walk == walk)
        line = floor_map.xy_m[rows[np.argsort(floor_map.order[rows], kind="stable")]]
        gaps = np.flatnonzero(np.linalg.norm(np.diff(line, axis=0), axis=1) > GAP_M) + 1
        found += [(int(walk), part) for part in np.split(line, gaps)]
    return found


def sigma_m(floor_map: FloorMap) -> F64:
    """The uncertainty (m) of each spot, root mean square per axis."""
    return np.asarray(np.sqrt(np.trace(floor_map.covariance_m2, axis1=1, axis2=2) / 2))


def map_features(
    floor_map: FloorMap,
    origin: Origin,
    cells: Sequence[tuple[F64, Feature]] = (),
    points_of_interest: Sequence[PointOfInterest] = (),
) -> list[Feature]:
    """Walks as LineStrings, spots and points of interest as Points, and cells as Polygons.

    A cell is a ring (k, 2) and its properties.
    """
    features = [*_walks(floor_map, origin), *_spots(floor_map, origin)]
    features += [feature(polygon_of(origin, (ring,)), told) for ring, told in cells]
    return features + [_point_of_interest(origin, each) for each in points_of_interest]


def on_level(features: Sequence[Feature], level: int) -> list[Feature]:
    """The features with the property `level`, as Simple Indoor Tagging writes it."""
    return [
        {**each, "properties": {**each["properties"], "level": str(level)}} for each in features
    ]


def passage_feature(passage: Passage, origin: Origin) -> Feature:
    """A passage as the line between its ends, on the levels of both."""
    ends_m = np.array([passage.from_xy_m, passage.to_xy_m])
    geometry = {"type": "LineString", "coordinates": positions(origin, ends_m)}
    levels = f"{passage.from_level};{passage.to_level}"
    told = {"kind": "passage", "category": passage.kind, "duration_s": passage.duration_s}
    return feature(geometry, {**told, "level": levels})


def write_geojson(file: Path, features: Sequence[Feature]) -> None:
    """A collection of features."""
    content = {"type": "FeatureCollection", "features": list(features)}
    file.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")


def feature(geometry: Feature | None, properties: Feature) -> Feature:
    """A GeoJSON feature."""
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def polygon_of(origin: Origin, polygon: Polygon) -> Feature:
    """A polygon's geometry; its rings are closed."""
    rings = [positions(origin, np.vstack([ring, ring[:1]])) for ring in polygon]
    return {"type": "Polygon", "coordinates": rings}


def point_of(origin: Origin, xy_m: F64) -> Feature:
    """A point's geometry."""
    return {"type": "Point", "coordinates": positions(origin, xy_m[None, :])[0]}


def positions(origin: Origin, xy_m: F64) -> list[list[float]]:
    """Longitude and latitude of points (n, 2), rounded."""
    rounded: list[list[float]] = np.round(to_lon_lat(origin, xy_m), DIGITS).tolist()
    return rounded


def _point_of_interest(origin: Origin, point: PointOfInterest) -> Feature:
    told = {"kind": "point_of_interest", "name": point.name, "category": point.kind}
    return feature(point_of(origin, np.array([point.x_m, point.y_m])), told)


def _walks(floor_map: FloorMap, origin: Origin) -> Iterator[Feature]:
    for walk, line in walk_lines(floor_map):
        if len(line) > 1:
            geometry = {"type": "LineString", "coordinates": positions(origin, line)}
            told = {"kind": "walk", "walk": walk, "source": _source(floor_map, walk)}
            yield feature(geometry, told)


def _source(floor_map: FloorMap, walk: int) -> str | None:
    return floor_map.sources[walk] if walk < len(floor_map.sources) else None


def _spots(floor_map: FloorMap, origin: Origin) -> Iterator[Feature]:
    places = positions(origin, floor_map.xy_m)
    bearings = bearings_deg(origin, floor_map.heading_rad)
    for k, sigma in enumerate(sigma_m(floor_map)):
        told = {
            "kind": "spot",
            "walk": int(floor_map.walk[k]),
            "order": int(floor_map.order[k]),
            "bearing_deg": round(float(bearings[k]), 2),
            "sigma_m": round(float(sigma), 4),
        }
        yield feature({"type": "Point", "coordinates": places[k]}, told)


def write_parquet(file: Path, floor_map: FloorMap) -> None:
    """Positions, covariances and, a list per spot, what each modality knows there.

    Where the map came from stands in the metadata of the table.
    """
    import pyarrow
    from pyarrow import parquet

    table = pyarrow.table(_columns(floor_map, pyarrow)).replace_schema_metadata(
        _metadata(floor_map)
    )
    with file.open("wb") as stream:  # a name of any locale
        parquet.write_table(table, stream)


def _columns(floor_map: FloorMap, pyarrow: Any) -> dict[str, Any]:
    covariance = floor_map.covariance_m2
    columns: dict[str, Any] = {
        "x_m": floor_map.xy_m[:, 0].copy(),
        "y_m": floor_map.xy_m[:, 1].copy(),
        "heading_rad": floor_map.heading_rad,
        "walk": floor_map.walk,
        "order": floor_map.order,
        "covariance_xx_m2": covariance[:, 0, 0].copy(),
        "covariance_xy_m2": covariance[:, 0, 1].copy(),
        "covariance_yy_m2": covariance[:, 1, 1].copy(),
    }
    for payload in floor_map.payloads:
        flat = pyarrow.array(np.ascontiguousarray(payload.vectors).reshape(-1))
        size = payload.vectors.shape[1]
        columns[payload.kind] = pyarrow.FixedSizeListArray.from_arrays(flat, size)
    return columns


def _metadata(floor_map: FloorMap) -> dict[str, str]:
    encoders = {payload.kind: payload.encoder for payload in floor_map.payloads}
    return {
        "sources": json.dumps(floor_map.sources),
        "encoders": json.dumps(encoders),
        "parameters_digest": floor_map.parameters_digest,
    }


FREE, UNKNOWN = 254, 205
FREE_BELOW, OCCUPIED_ABOVE = 0.196, 0.65
"""The thresholds of map_server's own saver; 205 lies just above the first."""


def image_beside(file: Path) -> Path:
    """Where the image of a YAML file goes. Raises InputError where that is not called .yaml."""
    if file.suffix not in (".yaml", ".yml"):
        raise InputError(f"{file}: wanted a name that ends in .yaml (the image goes beside it)")
    return file.with_suffix(".pgm")


def ros_map(grid: FloorGrid, image: str) -> tuple[str, bytes]:
    """The YAML text, which names the image, and the PGM image: free where walked, else unknown."""
    pixels = np.where(grid.free[::-1], FREE, UNKNOWN).astype(np.uint8)
    rows, columns = pixels.shape
    x, y = grid.corner_m.tolist()
    lines = [
        f"image: {json.dumps(image, ensure_ascii=False)}",
        f"resolution: {grid.cell_m:.9g}",
        f"origin: [{x:.6f}, {y:.6f}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {OCCUPIED_ABOVE}",
        f"free_thresh: {FREE_BELOW}",
    ]
    picture = f"P5\n{columns} {rows}\n255\n".encode() + pixels.tobytes()
    return "\n".join(lines) + "\n", picture


VERTEX, EDGE, SKIPPED = "VERTEX_SE2", "EDGE_SE2", ("FIX", "#")
UPPER = np.triu_indices(3)


@dataclass(frozen=True, eq=False)
class Row:
    """A row of the file: where it stands (1 is the first), and its numbers."""

    number: int
    numbers: list[float]


def read_g2o(file: Path) -> PoseGraph:
    """The pose graph of a file; poses are numbered from 0 in the order of their ids.

    The first edge from each pose to the next is a step, all others are closures. Where the file
    holds edges alone, the poses are chained from its steps. Raises InputError, naming the row.
    """
    vertices, edges = _rows(file)
    if not edges:
        raise InputError(f"{file}: has no {EDGE} row; wanted a pose graph with edges")
    table = np.array([edge.numbers for edge in edges])
    known = np.array([vertex.numbers for vertex in vertices]).reshape(-1, 4)
    ids = np.unique(known[:, 0] if vertices else table[:, :2])
    if vertices and len(ids) < len(vertices):
        raise InputError(f"{file}: {VERTEX} rows share an id; remove the repeated ones")
    ends = _ends(file, edges, ids)
    closure = _is_closure(ends)
    measured = table[:, 2:5]
    poses = known[np.argsort(known[:, 0]), 1:]
    if not vertices:
        poses = _chained(file, ends[~closure], measured[~closure], ids)
    return PoseGraph(poses, ends, measured, _information(file, edges), closure)


def write_g2o(file: Path, graph: PoseGraph, world_from_body: F64 | None = None) -> None:
    """Write a graph with its initial poses, or with others (n, 3), solved ones say.

    Every digit is kept. Raises InputError where there is not a pose for each node.
    """
    poses = graph.initial if world_from_body is None else world_from_body
    if poses.shape != graph.initial.shape:
        raise InputError(
            f"graph: got {len(poses)} poses for a graph of {len(graph.initial)}; "
            "pass those of the same walk"
        )
    lines = [f"{VERTEX} {k} {_text(pose)}" for k, pose in enumerate(poses)]
    for (i, j), measured, information in zip(
        graph.edges, graph.measurements, graph.information, strict=True
    ):
        lines.append(f"{EDGE} {i} {j} {_text(measured)} {_text(information[UPPER])}")
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _text(numbers: F64) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _rows(file: Path) -> tuple[list[Row], list[Row]]:
    found: dict[str, list[Row]] = {VERTEX: [], EDGE: []}
    for number, line in enumerate(read_lines(file), start=1):
        kind, *cells = line.split() or ["#"]
        if kind.startswith(SKIPPED):
            continue
        if kind not in found:
            raise InputError(f"{file}: row {number} is {kind[:30]}, {_advice(kind)}")
        wanted = 4 if kind == VERTEX else 11
        if len(cells) != wanted:
            raise InputError(
                f"{file}: row {number} has {len(cells)} numbers after {kind}, wanted {wanted}; "
                "the file is damaged there, repair that row"
            )
        found[kind].append(Row(number, [_number(file, number, cell) for cell in cells]))
    return found[VERTEX], found[EDGE]


def _advice(kind: str) -> str:
    if "SE3" in kind or "3D" in kind.upper():
        return f"of a graph in space; wanted {VERTEX} and {EDGE}, project it onto the floor first"
    return f"wanted {VERTEX} or {EDGE}; remove landmarks and whatever else is no pose or move"


def _number(file: Path, row: int, cell: str) -> float:
    number = number_or_nan(cell)
    if not np.isfinite(number):
        raise InputError(
            f"{file}: row {row} has {cell[:30]!r}, wanted a finite number; repair that row"
        )
    return number


def _ends(file: Path, edges: list[Row], ids: F64) -> I64:
    """The poses (e, 2) that edges join, numbered by their place among the ids."""
    named = np.array([edge.numbers[:2] for edge in edges])
    places = np.minimum(np.searchsorted(ids, named), len(ids) - 1)
    bad = (ids[places] != named).any(axis=1) | (named != np.round(named)).any(axis=1)
    bad |= named[:, 0] == named[:, 1]
    if bad.any():
        edge = edges[int(np.argmax(bad))]
        i, j = edge.numbers[:2]
        raise InputError(
            f"{file}: row {edge.number} joins {i:g} and {j:g}, wanted two ids that have a "
            f"{VERTEX} row; add the missing one or remove the edge"
        )
    return places


def _is_closure(ends: I64) -> Bool:
    """Every edge (e) but the first that leads from a pose to the next."""
    onward = np.flatnonzero(ends[:, 1] - ends[:, 0] == 1)
    _, first = np.unique(ends[onward, 0], return_index=True)
    closure = np.ones(len(ends), dtype=np.bool_)
    closure[onward[first]] = False
    return closure


def _chained(file: Path, steps: I64, moves: F64, ids: F64) -> F64:
    missing = np.setdiff1d(np.arange(len(ids) - 1), steps[:, 0])
    if len(missing):
        raise InputError(
            f"{file}: has no {VERTEX} rows and no {EDGE} from {ids[missing[0]]:g} to "
            f"{ids[missing[0] + 1]:g}; add either, so that every pose has a place to start from"
        )
    return chain(np.zeros(3), moves[np.argsort(steps[:, 0])])


def _information(file: Path, edges: list[Row]) -> F64:
    """The information matrices (e, 3, 3). Raises InputError where one is not positive."""
    upper = np.array([edge.numbers[5:] for edge in edges])
    information = np.zeros((len(edges), 3, 3))
    information[:, UPPER[0], UPPER[1]] = information[:, UPPER[1], UPPER[0]] = upper
    bad = np.linalg.eigvalsh(information)[:, 0] <= 0
    if bad.any():
        raise InputError(
            f"{file}: row {edges[int(np.argmax(bad))].number} has an information matrix that is "
            "not positive definite; give each edge finite sigmas"
        )
    return information
