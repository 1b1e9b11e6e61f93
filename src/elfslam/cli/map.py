"""elfslam map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.anchor import drawn_plan
from elfslam.app.console import progress_bar, say
from elfslam.app.map import (
    MapJob,
    breaks,
    kept_closures,
    map_into,
    map_many,
    parse_start,
    recordings_in,
    refuse_unclosed,
)
from elfslam.app.settings import Settings
from elfslam.app.workers import open_workers
from elfslam.base.enums import parse_modalities, parse_stretch
from elfslam.base.parameters import load
from elfslam.base.values import Run
from elfslam.cli.options import (
    EncoderName,
    Force,
    On,
    ParameterFile,
    Plan,
    Setting,
    refuse_if_none,
    say_refused,
)
from elfslam.data.map_files import MISSING, NOTES, read_facts
from elfslam.slam.coverage import Missing


def map_command(
    recording: Annotated[Path, typer.Argument(help="A recording, or a folder of recordings.")],
    out: Annotated[Path, typer.Argument(help="The run folder, or the folder of run folders.")],
    by: Annotated[str | None, typer.Option(help="elf,wifi,magnetic,emr or motion.")] = None,
    start: Annotated[
        str | None, typer.Option(help="X,Y,HEADING of the start (m, m, rad), or X,Y.")
    ] = None,
    encoder: EncoderName = "compact",
    from_s: Annotated[
        float | None, typer.Option("--from", min=0, help="Seconds into the recording to begin at.")
    ] = None,
    until_s: Annotated[
        float | None, typer.Option("--until", min=0, help="Seconds into the recording to end at.")
    ] = None,
    finetune: Annotated[bool, typer.Option(help="The encoder first learns this walk.")] = False,
    plan: Plan = None,
    force: Force = False,
    on: On = None,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Map a recording: dead reckoning, closures, straightened trajectory, map and report."""
    settings = load(Settings(), parameter_file, setting or [])
    drawn = drawn_plan(plan)
    kept_s = parse_stretch(from_s, until_s)
    job = MapJob(
        parse_modalities(by), parse_start(start), encoder, settings, force, finetune, kept_s
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


def _say_mapped(run: Run, out: Path) -> None:
    facts = read_facts(out)
    for line in [] if run.echoes is None else breaks(run.echoes):
        say(line)
    for note in facts.get(NOTES, []):
        say(note)
    for each in facts.get(MISSING, []):
        say(str(Missing(**each)))
    if "finetuning" in facts:
        say(f"fine-tuning: {facts['finetuning']}")
    say(
        f"{len(run.trajectory.t_s)} footsteps, {len(run.closures.i)} closures, "
        f"{kept_closures(run)} kept; heading {facts['heading']}; "
        f"look at {out / 'report.html'}"
    )
    refuse_unclosed(run)
