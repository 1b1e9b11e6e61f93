"""elfslam import, phyphox and marks: recordings made by other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from elfslam.app.console import print_rows, progress_bar, say
from elfslam.app.settings import Settings
from elfslam.base.errors import InputError
from elfslam.base.parameters import load
from elfslam.cli.options import AsJson, Force, ParameterFile, Setting, refuse_if_none, say_refused
from elfslam.data import importing
from elfslam.data.atomic_files import new_file, refuse_occupied
from elfslam.data.phyphox import BYTES_PER_SAMPLE, RATE_HZ, phyphox_experiment
from elfslam.data.recordings import read_recording, write_recording
from elfslam.data.truth_files import TRUTH_FILES, WAYPOINTS, read_marks, stood_on, write_truth

AUTO = "auto"
FORMATS = (AUTO, *importing.LogFormat)


def import_command(
    log_format: Annotated[
        str,
        typer.Argument(metavar="FORMAT", help=f"{', '.join(FORMATS)}; {AUTO} looks what it is."),
    ],
    path: Annotated[Path, typer.Argument(help="The log, or a folder of them.")],
    out: Annotated[
        Path, typer.Argument(help="A recording folder; where there are many, a folder of them.")
    ],
    declare_start: Annotated[
        bool, typer.Option("--declare-start", help="The first waypoint is the declared start.")
    ] = False,
    drift_seed: Annotated[int, typer.Option(min=0, help="Drift of the magnetic odometry.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Turn someone else's log into recordings."""
    known = _format_of(log_format, path)
    if not importing.takes_many(known, path):
        refuse_occupied(out, None)
    count = damaged = 0
    refused: dict[str, str] = {}
    with progress_bar() as announce:
        for item in importing.read_logs(known, path, np.random.default_rng(drift_seed)):
            if isinstance(item, importing.Refused):
                refused[item.name] = item.reason
                continue
            announce(item.recording.name, None)
            folder = out / item.recording.name if importing.takes_many(known, path) else out
            recording = importing.declared_start(item) if declare_start else item.recording
            write_recording(recording, folder, truth=item.truth)
            for note in recording.notes:
                say(f"{recording.name}: {note}")
            count, damaged = count + 1, damaged + item.damaged_lines
    refuse_if_none("imported", path, refused, count)
    summary = {"format": str(known), "recordings": count, "damaged_lines": damaged}
    print_rows([summary], title="Imported", as_json=as_json)
    say_refused("imported", refused)


def _format_of(named: str, path: Path) -> importing.LogFormat:
    if named not in FORMATS:
        raise InputError(f"format {named!r:.40}: wanted {', '.join(FORMATS)}")
    found = importing.recognise(path) if named == AUTO else importing.LogFormat(named)
    if found is None:
        raise InputError(f"{path}: is a recording already; elfslam map reads it as it is")
    return found


def phyphox_command(
    out: Annotated[Path, typer.Argument(help="A file, such as elfslam.phyphox.")],
    minutes: Annotated[float, typer.Option(min=0.1, max=30, help="Longest walk.")] = 2.0,
    force: Force = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Write an experiment for the phyphox app that chirps and records, without our page."""
    parameters = load(Settings(), parameter_file, setting or [])
    made = phyphox_experiment(parameters.chirp, minutes)
    with new_file(out, overwrite=force) as partial:
        partial.write_bytes(made)
    megabytes = minutes * 60 * RATE_HZ * BYTES_PER_SAMPLE / 1e6
    say(f"wrote {out}; a walk of {minutes:g} minutes takes about {megabytes:.0f} MB on Android")


def marks_command(
    walk: Annotated[Path, typer.Argument(help="The recording's folder; waypoints.csv goes there.")],
    marks: Annotated[Path, typer.Argument(help="CSV name,x_m,y_m of the marks on the floor.")],
    visited: Annotated[list[str], typer.Argument(help="Names of the marks, as stood on.")],
) -> None:
    """Give a walk its truth: the marks that the walker stood still on, in that order."""
    if not walk.is_dir():
        raise InputError(f"{walk}: is no folder; unpack the recording first")
    taken = [name for name in TRUTH_FILES if (walk / name).exists()]
    if taken:
        raise InputError(f"{walk / taken[0]}: is there already; delete it to write another")
    imu = read_recording(walk).imu
    if imu is None:
        raise InputError(
            f"{walk}: has no motion to find the pauses in; write waypoints.csv by hand"
        )
    truth = stood_on(imu, read_marks(marks), visited)
    write_truth(truth, walk)
    span = f"{truth.t_s[0]:.0f} to {truth.t_s[-1]:.0f} s"
    say(f"wrote {walk / WAYPOINTS}: {len(truth.t_s)} marks, {span}")
