"""elfslam simulate, import, phyphox and marks: where recordings come from."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from elfslam.app.console import compilation_announced, print_rows, progress_bar, say
from elfslam.app.settings import Settings
from elfslam.base.errors import InputError
from elfslam.base.parameters import load
from elfslam.cli import options
from elfslam.data import importing
from elfslam.data.atomic_files import new_file, refuse_occupied
from elfslam.data.phyphox import BYTES_PER_SAMPLE, RATE_HZ, phyphox_experiment
from elfslam.data.recordings import read_recording, write_recording
from elfslam.data.truth_files import TRUTH_FILES, WAYPOINTS, read_marks, stood_on, write_truth
from elfslam.stages.chirp import describe_chirp
from elfslam.world.building import building_names, load_place, parse_plan
from elfslam.world.circumstances import ENGINES, SOUNDS, parse_sounds
from elfslam.world.device import DEVICES, GRADES, built_in_grade
from elfslam.world.kinds import KINDS, SURVEYOR, kind_named
from elfslam.world.sensors import parse_sensors
from elfslam.world.simulate import WALKERS
from elfslam.world.simulate_building import simulate_place, usual_day
from elfslam.world.world_file import world_names

PLACES = world_names() + building_names()


def simulate_command(
    world: Annotated[str, typer.Argument(help=f"{', '.join(PLACES)} or a TOML file.")],
    out: Annotated[Path, typer.Argument(help="Folder for the recording and its truth.")],
    seed: options.Seed = 0,
    rounds: Annotated[int | None, typer.Option(min=1, help="5 laps, 2 on every floor.")] = None,
    plan: Annotated[str, typer.Option(help="Levels of a building as walked, such as 0,1,0.")] = "",
    rate_hz: Annotated[int, typer.Option("--rate", help="44100 or 48000 Hz.")] = 44_100,
    reverse: Annotated[bool, typer.Option("--reverse", help="The other way round.")] = False,
    kind: Annotated[
        str, typer.Option(help=f"Of walk: {', '.join(KINDS)}; the options below change it.")
    ] = SURVEYOR.name,
    asking: Annotated[
        bool, typer.Option("--asking", help="As a query walk in a map: another day, phone and way.")
    ] = False,
    walker: Annotated[str | None, typer.Option(help=f"{' or '.join(WALKERS)}.")] = None,
    sensors: Annotated[
        str, typer.Option(help="Besides sound and motion: wifi,magnetic,emr,barometer.")
    ] = "",
    state: Annotated[str, typer.Option(help="A state of the world's furniture.")] = "",
    day: Annotated[int | None, typer.Option(help="Days since the world was drawn.")] = None,
    lived_in: Annotated[
        bool | None,
        typer.Option("--lived-in/--as-drawn", help="Doors and warmth are of the day, or told."),
    ] = None,
    people: Annotated[int | None, typer.Option(help="How many others walk about.")] = None,
    device: Annotated[str | None, typer.Option(help=f"{', '.join(DEVICES)}.")] = None,
    volume: Annotated[float, typer.Option(help="Share of the phone's full level.")] = 1.0,
    sounds: Annotated[str, typer.Option(help=f"Heard besides: {','.join(SOUNDS)}.")] = "",
    other_phones: Annotated[int, typer.Option(help="How many others chirp in the room.")] = 0,
    engine: Annotated[str | None, typer.Option(help=f"{' or '.join(ENGINES)}.")] = None,
    imu: Annotated[str, typer.Option(help=f"{', '.join(GRADES)}.")] = "BMI160",
    jitter: Annotated[float, typer.Option(help="Chirps are late by up to this (s).")] = 0.0,
    softer: Annotated[float, typer.Option(help="Chirps are by chance softer by this (dB).")] = 0.0,
) -> None:
    """Simulate a walk with a phone: a recording, and its truth beside it for scoring."""
    refuse_occupied(out, None)
    place, whose = load_place(world), kind_named(kind)
    usual, place = usual_day(place, whose, seed, asking=asking)
    changed: dict[str, Any] = {
        "day": day, "lived_in": lived_in, "people": people, "device": device, "engine": engine,
    }  # fmt: skip
    today = replace(
        usual, state=state, volume=volume, sounds=parse_sounds(sounds), other_phones=other_phones,
        jitter_s=jitter, softer_db=softer,
        **{name: value for name, value in changed.items() if value is not None},
    )  # fmt: skip
    with progress_bar() as announce, compilation_announced(announce):
        recording, truth = simulate_place(
            place, seed, plan=parse_plan(plan), rate_hz=rate_hz, reverse=reverse,
            **({"rounds": rounds} if rounds else {}),
            walker=walker or whose.walker, sensors=parse_sensors(sensors),
            grade=built_in_grade(imu), circumstances=today,
            progress=lambda share: announce(f"simulating {world}", share),
        )  # fmt: skip
    write_recording(recording, out, chirp_description=describe_chirp(), truth=truth)
    say(f"wrote {out} ({truth.t_s[-1]:.0f} s)")


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
    as_json: options.AsJson = False,
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
    options.refuse_if_none("imported", path, refused, count)
    summary = {"format": str(known), "recordings": count, "damaged_lines": damaged}
    print_rows([summary], title="Imported", as_json=as_json)
    options.say_refused("imported", refused)


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
    force: options.Force = False,
    parameter_file: options.ParameterFile = None,
    setting: options.Setting = None,
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
