"""Runs and maps as files that other programs open."""

import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.building import Building
from elfslam.base.enums import Format
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.grid import BODY_RADIUS_M, walked_grid
from elfslam.base.text_files import readable
from elfslam.base.values import FloorMap, LevelPassage, PointKind, PointOfInterest, Run
from elfslam.data import map_exports
from elfslam.data.atomic_files import new_file, settled
from elfslam.data.building_files import floor_folder, is_building, read_building
from elfslam.data.geographic import Origin
from elfslam.data.imdf import Venue, WalkedLevel, write_imdf
from elfslam.data.map_files import ENCODER, FACTS, MAP, read_map
from elfslam.data.named_places import read_points
from elfslam.data.position_files import write_tum
from elfslam.data.runs import read_run
from elfslam.data.tables import read_table
from elfslam.stages.graph import build_graph

COVERAGE = "quality.csv"
"""Beside a map of several walks: what is known of each square of it."""

FINEST_M, COARSEST_M = 0.01, 1.0
"""Pixels of an image; what is coarser than a person shows nothing."""


@dataclass(frozen=True)
class ExportContext:
    """What no map knows and some formats ask for."""

    origin: Origin | None = None
    place: Venue | None = None
    pixel_m: float = 0.05
    """Side of a pixel of an image."""


def export(
    source: Path,
    out: Path,
    to: Format,
    context: ExportContext | None = None,
    *,
    overwrite: bool = False,
) -> None:
    """Write a run or a map as a file of another format, whole or not at all.

    A ROS map is two files, and two for each floor of a building, whose names end in its level. An
    older file is only replaced with `overwrite`. Raises InputError where the run does not hold what
    the format asks for, ParameterError where something is missing, StoreError where it cannot be
    read or the file cannot be written.
    """
    new = partial(new_file, overwrite=overwrite, reads=[source])
    if to is Format.ROS and is_building(settled(source)):
        for level in read_building(source).levels:
            file = out.with_name(f"{out.stem}_{level}{out.suffix}")
            export(floor_folder(source, level), file, to, context, overwrite=overwrite)
        return
    if to is Format.ROS:
        image = map_exports.image_beside(out)
        with new(out) as file, new(image) as picture:
            _ros(settled(source), file, picture, readable(image.name), context or ExportContext())
        return
    with new(out) as file:
        EXPORTS[to](settled(source), file, context or ExportContext())


def map_of(source: Path) -> FloorMap:
    """The map of a run folder, a map folder or an .npz file.

    A run without a map, one by Wi-Fi say, gives a spot per footstep. Raises StoreError.
    """
    if is_building(source) or not (source / FACTS).is_file() or (source / MAP).is_file():
        return read_map(source)
    run = read_run(source)
    poses, count = run.trajectory.world_from_body, len(run.trajectory.t_s)
    order = np.arange(count)
    covariance = run.trajectory.covariance[:, :2, :2]
    walk = np.zeros(count, dtype=np.int64)
    return FloorMap(poses[:, :2], poses[:, 2], walk, order, covariance, (), "", (run.name,))


def _tum(source: Path, out: Path, context: ExportContext) -> None:
    """The straightened trajectory."""
    trajectory = _run(source).trajectory
    write_tum(out, trajectory.t_s, trajectory.world_from_body)


def _g2o(source: Path, out: Path, context: ExportContext) -> None:
    """The pose graph: steps and all closures, the straightened poses as first guess."""
    run = _run(source)
    graph = build_graph(run.odometry, run.closures)
    map_exports.write_g2o(out, graph, run.trajectory.world_from_body)


def _onnx(source: Path, out: Path, context: ExportContext) -> None:
    """The encoder that others are located by."""
    folder = (
        floor_folder(source, read_building(source).levels[0]) if is_building(source) else source
    )
    encoder = folder / ENCODER
    if not encoder.is_file():
        raise InputError(f"{source}: holds no {ENCODER}; map it by its echoes first", argument="by")
    shutil.copyfile(encoder, out)


def _geojson(source: Path, out: Path, context: ExportContext) -> None:
    """Walks, spots, squares of coverage and points of interest on the Earth."""
    origin = _origin(context)
    if not is_building(source):
        map_exports.write_geojson(out, _features(source, origin))
        return
    building = read_building(source)
    floors = [
        map_exports.on_level(_features(floor_folder(source, level), origin), level)
        for level in building.levels
    ]
    passages = [map_exports.passage_feature(each, origin) for each in building.passages]
    map_exports.write_geojson(out, [*chain.from_iterable(floors), *passages])


def _features(source: Path, origin: Origin) -> list[map_exports.Feature]:
    return map_exports.map_features(map_of(source), origin, _coverage(source), read_points(source))


def _imdf(source: Path, out: Path, context: ExportContext) -> None:
    origin = _origin(context)
    if context.place is None:
        raise ParameterError(
            "place: the format asks for the name and the address of the venue; "
            "give a TOML file with name, category, address, locality, country, level and ordinal",
            argument="place",
        )
    if is_building(source):
        levels = _walked_levels(source, context.place)
    else:
        levels = [WalkedLevel(context.place, _lines(source), read_points(source))]
    write_imdf(out, levels, origin, datetime.now(UTC))


def _walked_levels(source: Path, place: Venue) -> list[WalkedLevel]:
    """The floors of a building; what is said of the place is said of its level 0."""
    building = read_building(source)
    levels = []
    for level in building.levels:
        folder, ordinal = floor_folder(source, level), place.ordinal + level
        named = {"level": f"Level {ordinal}", "level_short_name": str(ordinal)} if level else {}
        points = [*read_points(folder), *_passage_points(building, level)]
        there = replace(place, ordinal=ordinal, **named)
        levels.append(WalkedLevel(there, _lines(folder), points))
    return levels


def _passage_points(building: Building, level: int) -> Iterator[PointOfInterest]:
    """Where passages leave a floor, as points on it."""
    for each in building.passages:
        ends = {each.from_level: each.from_xy_m, each.to_level: each.to_xy_m}
        if level in ends:
            kind = PointKind.LIFT if each.kind is LevelPassage.LIFT else PointKind.STAIRS
            name = f"{each.kind.capitalize()} {each.from_level} - {each.to_level}"
            yield PointOfInterest(name, kind, *ends[level])


def _ros(source: Path, file: Path, picture: Path, image: str, context: ExportContext) -> None:
    """The walked ground as an image of that name."""
    if not FINEST_M <= context.pixel_m <= COARSEST_M:
        raise ParameterError(
            f"resolution: got {context.pixel_m:g}, wanted {FINEST_M:g} to {COARSEST_M:g} m; "
            "0.05 is usual",
            argument="resolution",
        )
    text, content = map_exports.ros_map(
        walked_grid(_lines(source), BODY_RADIUS_M, context.pixel_m), image
    )
    file.write_text(text, encoding="utf-8")
    picture.write_bytes(content)


def _run(source: Path) -> Run:
    if not (source / FACTS).is_file():
        raise InputError(
            f"{source}: wanted the run of one walk, got a map, which keeps neither times nor "
            f"closures (no {FACTS}); export each walk's run"
        )
    return read_run(source)


def _lines(source: Path) -> list[F64]:
    return [line for _, line in map_exports.walk_lines(map_of(source))]


def _origin(context: ExportContext) -> Origin:
    if context.origin is None:
        raise ParameterError(
            "origin: a map does not know where on the Earth it lies; give "
            "LAT,LON[,BEARING_DEG] of its origin and x axis, such as 47.3769,8.5417,90",
            argument="origin",
        )
    return context.origin


def _coverage(source: Path) -> list[tuple[F64, map_exports.Feature]]:
    """The squares (4, 2) of a map whose coverage is known, and what is known of them."""
    file = source / COVERAGE
    if not source.is_dir() or not file.is_file():
        return []
    names = ("x_m", "y_m", "walks", "spots", "sigma_m")
    table = read_table(file, names)
    middles = table[:, :2]
    gaps = np.abs(np.diff(np.sort(middles, axis=0), axis=0))
    half_m = float(np.min(gaps[gaps > 1e-6], initial=1.0)) / 2
    corners = half_m * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return [
        (xy_m + corners, {"kind": "coverage", "walks": int(n), "spots": int(m), "sigma_m": s})
        for xy_m, (n, m, s) in zip(middles, table[:, 2:].tolist(), strict=True)
    ]


EXPORTS: Mapping[Format, Callable[[Path, Path, ExportContext], None]] = {
    Format.TUM: _tum,
    Format.G2O: _g2o,
    Format.ONNX: _onnx,
    Format.GEOJSON: _geojson,
    Format.IMDF: _imdf,
    Format.PARQUET: lambda source, out, _: map_exports.write_parquet(out, map_of(source)),
}
