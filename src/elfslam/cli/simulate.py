"""elfslam simulate: a walk in a world, with its truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import progress_bar, say
from elfslam.cli.options import Seed
from elfslam.data.recordings import write_recording
from elfslam.world.circumstances import ENGINES, SOUNDS, Circumstances, parse_sounds
from elfslam.world.device import DEVICES, GRADES, built_in_grade
from elfslam.world.sensors import parse_sensors
from elfslam.world.simulate import WALKERS, describe_chirp, simulate
from elfslam.world.world_file import load_world, world_names


def simulate_command(
    world: Annotated[str, typer.Argument(help=f"{', '.join(world_names())} or a TOML file.")],
    out: Annotated[Path, typer.Argument(help="Folder for the recording and its truth.")],
    seed: Seed = 0,
    rounds: Annotated[int, typer.Option(min=1, help="Laps of the world's route.")] = 5,
    rate_hz: Annotated[int, typer.Option("--rate", help="44100 or 48000 Hz.")] = 44_100,
    reverse: Annotated[bool, typer.Option("--reverse", help="The other way round.")] = False,
    walker: Annotated[str, typer.Option(help=f"{' or '.join(WALKERS)}.")] = WALKERS[0],
    sensors: Annotated[str, typer.Option(help="Besides sound and motion: wifi,magnetic,emr.")] = "",
    state: Annotated[str, typer.Option(help="A state of the world's furniture.")] = "",
    day: Annotated[int, typer.Option(help="Days since the world was drawn.")] = 0,
    people: Annotated[int, typer.Option(help="How many others walk about.")] = 0,
    device: Annotated[str, typer.Option(help=f"{', '.join(DEVICES)}.")] = "simulated phone",
    volume: Annotated[float, typer.Option(help="Share of the phone's full level.")] = 1.0,
    sounds: Annotated[str, typer.Option(help=f"Heard besides: {','.join(SOUNDS)}.")] = "",
    other_phones: Annotated[int, typer.Option(help="How many others chirp in the room.")] = 0,
    engine: Annotated[str, typer.Option(help=f"{', '.join(ENGINES)}.")] = ENGINES[0],
    imu: Annotated[str, typer.Option(help=f"{', '.join(GRADES)}.")] = "BMI160",
    jitter: Annotated[float, typer.Option(help="Chirps are late by up to this (s).")] = 0.0,
    softer: Annotated[float, typer.Option(help="Chirps are by chance softer by this (dB).")] = 0.0,
) -> None:
    """Simulate a walk with a phone: a recording, and its truth beside it for scoring."""
    heard = parse_sounds(sounds)
    today = Circumstances(
        state, day, people, device, volume, heard, other_phones, engine, jitter, softer
    )
    with progress_bar() as announce:
        recording, truth = simulate(
            load_world(world),
            seed,
            rounds=rounds,
            rate_hz=rate_hz,
            reverse=reverse,
            walker=walker,
            sensors=parse_sensors(sensors),
            grade=built_in_grade(imu),
            circumstances=today,
            progress=lambda share: announce(f"simulating {world}", share),
        )
    write_recording(recording, out, chirp_description=describe_chirp(), truth=truth)
    say(f"wrote {out} ({truth.t_s[-1]:.0f} s)")
