"""Verbs that map and locate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam import slam
from elfslam.base.choices import Mode, parse_modalities
from elfslam.base.errors import NoAnswerError
from elfslam.base.parameters import load
from elfslam.base.values import FixStatus
from elfslam.cli.options import (
    AsJson,
    EncoderName,
    Force,
    On,
    ParameterFile,
    Plan,
    Setting,
    drawn_plan,
    refuse_if_none,
    say_refused,
)
from elfslam.console import print_rows, progress_bar, say
from elfslam.data.facts import read_facts
from elfslam.data.fixes_files import write_fixes
from elfslam.data.folders import settled
from elfslam.data.map_files import read_map
from elfslam.data.recordings import read_recording
from elfslam.hearing import heard_in
from elfslam.joining import merge_into
from elfslam.line.feature import load_encoder
from elfslam.line.phone import learn_phone
from elfslam.mapping import (
    MapJob,
    breaks,
    encoder_of,
    kept_closures,
    map_into,
    parse_start,
    refuse_unclosed,
)
from elfslam.mapping_many import map_many, recordings_in
from elfslam.merging import MergeParameters
from elfslam.senses import Settings
from elfslam.workers import open_workers


def map_command(
    recording: Annotated[Path, typer.Argument(help="A recording, or a folder of recordings.")],
    out: Annotated[Path, typer.Argument(help="The run folder, or the folder of run folders.")],
    by: Annotated[str | None, typer.Option(help="elf,wifi,magnetic,emr or motion.")] = None,
    start: Annotated[str | None, typer.Option(help="X,Y,HEADING of the start, m and rad.")] = None,
    encoder: EncoderName = "compact",
    finetune: Annotated[bool, typer.Option(help="The encoder first learns this walk.")] = False,
    calibrate: Annotated[bool, typer.Option(help="For other phones to be located.")] = False,
    plan: Plan = None,
    force: Force = False,
    on: On = None,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Map a recording: dead reckoning, closures, straightened trajectory, map and report."""
    known = load(Settings(), parameter_file, setting or [])
    drawn = drawn_plan(plan)
    job = MapJob(
        parse_modalities(by), parse_start(start), encoder, known, force, finetune, calibrate
    )
    paths = recordings_in(recording)
    with progress_bar() as announce:
        if paths == [recording]:
            run = map_into(out, recording, job, announce, drawn)
        else:
            with open_workers(on) as workers:
                refused = map_many(out, paths, job, announce, workers)
    if paths == [recording]:
        _say_mapped(run, out)
    else:
        mapped = len(paths) - len(refused)
        refuse_if_none("mapped", recording, refused, mapped)
        say(f"mapped {mapped} of {len(paths)} recordings into {out}")
        say_refused("mapped", refused)


def _say_mapped(run: slam.Run, out: Path) -> None:
    for line in [] if run.echoes is None else breaks(run.echoes):
        say(line)
    if "finetuning" in (facts := read_facts(out)):
        say(f"fine-tuning: {facts['finetuning']}")
    say(
        f"{len(run.trajectory.t_s)} footsteps, {len(run.closures.i)} closures, "
        f"{kept_closures(run)} kept; look at {out / 'report.html'}"
    )
    refuse_unclosed(run)


def locate_command(
    recording: Annotated[Path, typer.Argument(help="The recording to be located.")],
    floor_map: Annotated[Path, typer.Argument(metavar="MAP", help="A run folder.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.csv", help="Where the fixes go.")],
    encoder: Annotated[str | None, typer.Option(help="Default: the one beside the map.")] = None,
    mode: Annotated[
        Mode, typer.Option(help="From 0.6 s of sound, from 8 footsteps, or as one walks.")
    ] = Mode.ONE_SHOT,
    seed: Annotated[int, typer.Option(help="Of the tracker's draws.")] = 0,
    phone_walk: Annotated[
        Path | None, typer.Option(help="A walk of this phone in the map, to learn how it hears.")
    ] = None,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
    as_json: AsJson = False,
) -> None:
    """Locate a recording in a map: where it was, how surely, and where that cannot be said."""
    parameters = load(Settings(), parameter_file, setting or [])
    known = read_map(settled(floor_map))
    used = load_encoder(encoder) if encoder else encoder_of(floor_map, known)
    with progress_bar() as announce:
        announce("locating", None)
        heard = read_recording(recording, parameters.chirp)
        translation = None
        if phone_walk is not None:
            walk = read_recording(phone_walk, parameters.chirp)
            own = heard_in(known, walk, used, parameters)
            translation = learn_phone(own, known, parameters.phone)
        fixes = slam.locate(
            heard, known, used, parameters, mode=mode, seed=seed, translation=translation
        )
    write_fixes(fixes, out)
    counts = {status.name: int((fixes.status == status).sum()) for status in FixStatus}
    print_rows(
        [{"fixes": len(fixes.t_s), **counts}], title=f"Located in {floor_map}", as_json=as_json
    )
    if counts["OK"] == 0:
        raise NoAnswerError(f"{recording}: nowhere in {floor_map}; is it the same place?")


def merge_command(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="[MAP] RUN...", help="Oldest first, or a map and runs."),
    ],
    out: Annotated[Path, typer.Argument(help="The map folder.")],
    known_starts: Annotated[
        bool, typer.Option("--known-starts", help="All were mapped with --start in one frame.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an older map.")] = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
    as_json: AsJson = False,
) -> None:
    """Merge runs into one floor map, or add runs to a map that was merged before."""
    known = load(MergeParameters(), parameter_file, setting or [])
    with progress_bar() as announce:
        made = merge_into(out, runs, known, announce, known_starts=known_starts, overwrite=force)
    if made.pairs:
        print_rows(made.pairs, title="How they met", as_json=as_json)
    for name, why in made.refused.items():
        say(f"not merged: {name}: {why}")
    say(f"{len(made.floor_map.sources)} walks in one map; look at {out / 'report.html'}")
