"""elfslam demo, map, merge and superimpose: from recordings to maps."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from elfslam.app import map as mapping
from elfslam.app.anchor import drawn_plan
from elfslam.app.console import compilation_announced, print_rows, progress_bar, say
from elfslam.app.demo import run_demo
from elfslam.app.locate import merge_by_field
from elfslam.app.merge import (
    is_merged_building,
    merge_buildings_into,
    merge_into,
    superimpose_into,
)
from elfslam.app.settings import Settings
from elfslam.app.workers import open_workers
from elfslam.base.enums import Modality, parse_modalities, parse_stretch
from elfslam.base.errors import InputError
from elfslam.base.parameters import load
from elfslam.base.values import Run
from elfslam.cli import options
from elfslam.data.building_files import FLOORS, is_building, read_building
from elfslam.data.map_files import MISSING, NOTES, read_facts
from elfslam.slam.coverage import Missing
from elfslam.stages.feature import load_encoder


def demo(
    out: Annotated[Path, typer.Argument(help="Folder for recordings, map and reports.")],
    encoder: options.EncoderName = "compact",
    parameter_file: options.ParameterFile = None,
    setting: options.Setting = None,
    as_json: options.AsJson = False,
) -> None:
    """Map ten simulated surveys, locate others in them, write one of each with its reports."""
    parameters = load(Settings(), parameter_file, setting or [])
    with progress_bar() as announce, compilation_announced(announce):
        rows = run_demo(
            out,
            load_encoder(encoder),
            mapping.line_only(parameters),
            facts=mapping.versions(),
            announce=announce,
        )
    print_rows(rows, title="Ten surveys of a room of 60 m2, and ten query walks", as_json=as_json)
    say(f"look at {out / 'score.html'}, {out / 'fixes.html'} and {out / 'run' / 'report.html'}")


def map_command(
    recording: Annotated[Path, typer.Argument(help="A recording, or a folder of recordings.")],
    out: Annotated[Path, typer.Argument(help="The run folder, or the folder of run folders.")],
    by: Annotated[str | None, typer.Option(help="elf,wifi,magnetic,emr or motion.")] = None,
    start: Annotated[
        str | None, typer.Option(help="X,Y,HEADING of the start (m, m, rad), or X,Y.")
    ] = None,
    encoder: options.EncoderName = "compact",
    from_s: Annotated[
        float | None, typer.Option("--from", min=0, help="Seconds into the recording to begin at.")
    ] = None,
    until_s: Annotated[
        float | None, typer.Option("--until", min=0, help="Seconds into the recording to end at.")
    ] = None,
    finetune: Annotated[bool, typer.Option(help="The encoder first learns this walk.")] = False,
    plan: options.Plan = None,
    force: options.Force = False,
    on: options.On = None,
    parameter_file: options.ParameterFile = None,
    setting: options.Setting = None,
) -> None:
    """Map a recording: dead reckoning, closures, straightened trajectory, map and report."""
    settings = load(Settings(), parameter_file, setting or [])
    drawn = drawn_plan(plan)
    kept_s = parse_stretch(from_s, until_s)
    job = mapping.MapJob(
        parse_modalities(by), mapping.parse_start(start), encoder, settings, force, finetune, kept_s
    )
    paths = mapping.recordings_in(recording)
    with progress_bar() as announce:
        if paths == [recording]:
            run = mapping.map_into(out, recording, job, announce, drawn)
        else:
            with open_workers(on) as workers:
                refused = mapping.map_many(out, paths, job, announce, workers)
    if paths == [recording]:
        _say_mapped(run, out)
    else:
        mapped = len(paths) - len(refused)
        options.refuse_if_none("mapped", recording, refused, mapped)
        say(f"mapped {mapped} of {len(paths)} recordings into {out}")
        options.say_refused("mapped", refused)


def _say_mapped(run: Run, out: Path) -> None:
    facts = read_facts(out)
    for line in [] if run.echoes is None else mapping.breaks(run.echoes):
        say(line)
    for note in facts.get(NOTES, []):
        say(note)
    for each in facts.get(MISSING, []):
        say(str(Missing(**each)))
    if "finetuning" in facts:
        say(f"fine-tuning: {facts['finetuning']}")
    if is_building(out):
        building = read_building(out)
        floors = ", ".join(map(str, building.levels))
        say(f"floors {floors} in {out / FLOORS}; {len(building.passages)} passages between them")
    say(
        f"{len(run.trajectory.t_s)} footsteps, {len(run.closures.i)} closures, "
        f"{mapping.kept_closures(run)} kept; heading {facts['heading']}; "
        f"look at {out / 'report.html'}"
    )
    mapping.refuse_unclosed(run)


def merge_command(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="[MAP] RUN...",
            help="Oldest first, or a map and runs; with --by recordings, or folders of them.",
        ),
    ],
    out: Annotated[Path, typer.Argument(help="The map folder.")],
    by: Annotated[
        str | None, typer.Option(help="wifi,magnetic: recordings, each from its declared start.")
    ] = None,
    known_starts: Annotated[
        bool, typer.Option("--known-starts", help="All lie in one frame, by --start or taps.")
    ] = False,
    force: options.Force = False,
    parameter_file: options.ParameterFile = None,
    setting: options.Setting = None,
    as_json: options.AsJson = False,
) -> None:
    """Merge runs into one floor map, or add runs to a map that was merged before."""
    settings = load(Settings(), parameter_file, setting or [])
    if by is not None:
        _merge_by_field(out, runs, parse_modalities(by), settings, force=force)
        return
    buildings = [path for path in runs if is_building(path)]
    if buildings and len(buildings) < len(runs) and not any(map(is_merged_building, runs)):
        raise InputError(
            f"merge: {buildings[0]} is a building of one walk and not all others are; merge "
            f"buildings with each other, or one of its floors ({buildings[0] / FLOORS})"
        )
    with progress_bar() as announce:
        if buildings:
            building, made = merge_buildings_into(
                out, runs, settings, announce, known_starts=known_starts, overwrite=force
            )
        else:
            made = merge_into(
                out, runs, settings, announce, known_starts=known_starts, overwrite=force
            )
    if made.pairs:
        print_rows(made.pairs, title="How they met", as_json=as_json)
    for name, why in made.refused.items():
        say(f"not merged: {name}: {why}")
    if buildings:
        floors = ", ".join(f"{each.level} at {each.height_m:g} m" for each in building.floors)
        say(f"{', '.join(made.trajectories)} joined; floors {floors}, each in {out / FLOORS}")
    else:
        walks = len(made.floor_map.sources)
        say(f"{walks} walks in one map; look at {out / 'report.html'}")


def _merge_by_field(
    out: Path, paths: list[Path], by: tuple[Modality, ...], settings: Settings, *, force: bool
) -> None:
    with progress_bar() as announce:
        made = merge_by_field(out, paths, by, settings, announce, overwrite=force)
    for name, why in made.refused.items():
        say(f"not merged: {name}: {why}")
    turn, told = made.turn, np.isfinite(made.turn.sigma_rad)
    say(
        f"the floor lies {np.rad2deg(turn.turn_rad):.1f} +- {np.rad2deg(turn.sigma_rad):.1f} "
        "degrees from the compass, by the walks themselves"
        if told
        else "no two walks tell the angle of the floor: magnetic north is as declared"
    )
    say(
        f"{len(made.floor_map.sources)} walks in one map, {made.joined:.0%} of them corrected by "
        f"others; look at {out / 'report.html'}"
    )


def superimpose_command(
    source: Annotated[Path, typer.Argument(metavar="MAP", help="The map of several walks.")],
    out: Annotated[Path, typer.Argument(help="The map folder.")],
    learn: Annotated[
        list[Path] | None,
        typer.Option("--learn", metavar="RUN", help="A walk of MAP to learn from, repeatable."),
    ] = None,
    seed: options.Seed = 0,
    force: options.Force = False,
    parameter_file: options.ParameterFile = None,
    setting: options.Setting = None,
) -> None:
    """One feature per spot for all headings; with --learn its encoder is trained for them."""
    settings = load(Settings(), parameter_file, setting or [])
    with progress_bar() as announce:
        made = superimpose_into(
            out, source, learn or [], settings, announce, seed=seed, overwrite=force
        )
    say(f"{len(made.xy_m)} spots for all headings; look at {out / 'report.html'}")
