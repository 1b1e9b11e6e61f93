"""A merged map becomes one feature per spot for all headings: what `elfslam superimpose` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elfslam.app.locate import encoder_of
from elfslam.app.map import versions
from elfslam.app.settings import Settings
from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.parameters import as_dict, digest
from elfslam.base.text_files import readable
from elfslam.base.values import ELF_SIZE, Announce, FloorMap
from elfslam.data.atomic_files import new_folder, refuse_occupied, settled
from elfslam.data.map_files import read_map
from elfslam.data.merged_maps import MERGED, SUPERIMPOSED, fill_merged, is_superimposed, walk_in
from elfslam.data.points_of_interest_files import read_points
from elfslam.data.runs import read_run
from elfslam.learn.parameters import FloorLevelParameters
from elfslam.stages.feature import Encoder, OnnxEncoder
from elfslam.stages.floormap import (
    SpotEchoes,
    floor_spots,
    map_quality,
    nearest_covariance,
    superimposed,
    superimposed_map,
)
from elfslam.stages.locate import elf_payload


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
    from elfslam.scoring.merged_report import write_merged_report

    refuse_occupied(out, MERGED if overwrite else None)
    source = settled(map_path)
    if is_superimposed(source):
        raise InputError(f"{map_path}: is superimposed already; name the map that it was made of")
    floor_map = read_map(source)
    encoder = encoder_of(source, floor_map)
    if runs:
        walks = [_placed(source, run, announce) for run in runs]
        made, encoder = _learned(out, floor_map, walks, encoder, settings, announce, seed=seed)
    else:
        elfs = elf_payload(floor_map, encoder.identity, ELF_SIZE)
        made = superimposed(floor_map, elfs, settings.floor_level.spacing_m)
    made = replace(made, parameters_digest=digest(settings))
    quality = map_quality(made, settings.quality)
    facts = {
        **versions(),
        SUPERIMPOSED: True,
        "walks": list(made.sources),
        "learned_from": [run.name for run in runs],
        "parameters_digest": digest(settings),
        "parameters": as_dict(settings),
    }
    content = encoder.content if isinstance(encoder, OnnxEncoder) else None
    with new_folder(out, replaces=MERGED if overwrite else None) as partial:
        fill_merged(
            partial, made, quality, {}, facts=facts, encoder=content,
            points_of_interest=read_points(source),
        )  # fmt: skip
        write_merged_report(partial / "report.html", made, quality, [], {})
    if runs:
        _checkpoint(out).unlink(missing_ok=True)
    return made


def _placed(map_path: Path, path: Path, announce: Announce) -> SpotEchoes:
    """The echoes of a run where the map has them. Raises InputError where it has no such walk."""
    announce(f"reading {path.name}", None)
    echoes = read_run(path).echoes
    if echoes is None:
        raise InputError(f"{path}: holds no echoes; map its recording again, by its echoes")
    t_s, poses = walk_in(map_path, readable(path.name))
    inside = (echoes.t_s >= t_s[0]) & (echoes.t_s <= t_s[-1])
    if not inside.any():
        raise InputError(f"{path}: is not the walk of that name in {map_path}; check both")
    where = interpolate_poses(t_s, poses, echoes.t_s[inside])
    return SpotEchoes(echoes.samples[inside], where[:, :2], where[:, 2])


def _learned(
    out: Path,
    floor_map: FloorMap,
    walks: Sequence[SpotEchoes],
    encoder: Encoder,
    settings: Settings,
    announce: Announce,
    *,
    seed: int,
) -> tuple[FloorMap, OnnxEncoder]:
    """The map of the walks by an encoder that learned from them, and that encoder."""
    from elfslam.learn.floor_level import floor_elfs, learn_floor

    if not isinstance(encoder, OnnxEncoder):
        raise InputError("superimpose: the map's encoder cannot learn; leave the runs out")
    parameters = settings.floor_level
    spots_m = floor_spots(np.vstack([walk.xy_m for walk in walks]), parameters.spacing_m)
    learned = learn_floor(
        encoder, spots_m, lambda step: drawn(walks, parameters, seed, step), parameters,
        seed=seed, checkpoint=_checkpoint(out),
        report=lambda at: announce(f"learning, loss {at.loss:.2f}", at.step / parameters.steps),
    ).encoder  # fmt: skip
    vectors = floor_elfs(learned, spots_m, walks)
    made = superimposed_map(
        spots_m, vectors, learned.identity, spacing_m=parameters.spacing_m,
        sources=floor_map.sources, covariance_m2=nearest_covariance(floor_map, spots_m),
    )  # fmt: skip
    return made, learned


def drawn(
    walks: Sequence[SpotEchoes], parameters: FloorLevelParameters, seed: int, step: int
) -> SpotEchoes:
    """The echoes that a step learns from: as many of each walk, the same for a seed and step."""
    generator = np.random.default_rng([seed, 1, step])
    each = -(-parameters.batch // len(walks))
    rows = [generator.integers(0, len(walk.xy_m), each) for walk in walks]
    pairs = list(zip(walks, rows, strict=True))
    return SpotEchoes(
        np.concatenate([walk.samples[some] for walk, some in pairs]),
        np.concatenate([walk.xy_m[some] for walk, some in pairs]),
        np.concatenate([walk.heading_rad[some] for walk, some in pairs]),
    )


def _checkpoint(out: Path) -> Path:
    return out.with_name(f"{out.name}.checkpoint")
