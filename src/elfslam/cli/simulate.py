"""elfslam simulate: a walk in a world, with its truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from elfslam.app.console import compilation_announced, progress_bar, say
from elfslam.cli.options import Seed
from elfslam.data.atomic_files import refuse_occupied
from elfslam.data.recordings import write_recording
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
    seed: Seed = 0,
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
