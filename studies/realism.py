"""Are simulated rooms like measured ones? Statistics of their responses side by side, drawn.

Measured: two circles of loudspeakers in one room in eight states of its walls (R3VIVAL, CC BY 4.0).
Simulated: phones along the routes of the worlds, and in the rooms that encoders are trained in, by
mirror images with clutter and by mirror images with a diffuse field.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.baselines.generic import generic_encoders
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.scoring.figures import TRUTH
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.world.circumstances import Circumstances, engine_of, reach_of
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, built_in_device
from elfslam.world.phone import air_at, poses_at, room_responses
from elfslam.world.pulses import C64
from elfslam.world.random_world import random_room
from elfslam.world.room import Room
from elfslam.world.scattering import as_measured
from elfslam.world.scene import scene_of
from elfslam.world.world_file import load_world
from studies.figures.curves import Curve, curves_figure
from studies.finding import Finding, Given, Row
from studies.real_rooms import PERIOD_S, echo_of
from studies.room_statistics import banded, contrast, kurtosis, reverberation_s, spread_db

WORLDS = ("living_room", "office", "mall")
PLACES = 60
TRAINING_ROOMS = 20
MOVED_M = (0.0025, 0.005, 0.0125, 0.025, 0.05, 0.1, 0.2, 0.4)
"""Of the phone; a source that stays needs a microphone moved twice as far for as much."""
RATE_HZ = 48_000
FILES = {"2 m": "r3vival_2m.npz", "1.5 m": "r3vival_1.5m.npz"}
STATES = {"walls hard": 0, "absorbers out": 4}
KINDS = {"images": "mirror images and clutter", "diffuse": "diffuse field"}
NOTE = (
    "1: the echo stays what it is; 0: it has become that of another place. A microphone that moves "
    "beside a fixed source counts as a phone that moves half as far."
)


class Place(NamedTuple):
    """Responses (n, samples) from their direct sound on, and the same moved, by how far (m).

    `xy_m` (n, 2) is where they were heard, None where no two are near each other.
    """

    name: str
    kind: str
    responses: F64
    moved: Mapping[float, F64]
    xy_m: F64 | None = None


def measure_realism(
    given: Given,
    *,
    worlds: tuple[str, ...] = WORLDS,
    places: int = PLACES,
    rooms: int = TRAINING_ROOMS,
) -> Finding:
    """A row per room: kurtosis, spread, T60 and contrast; the contrast's curves are drawn.

    Without `data` there is no measured room. Places along the routes by seed 0.
    """
    found = [] if given.data is None else list(measured_places(given.data / "rirs"))
    tasks = [(kind, name) for kind in KINDS for name in (*worlds, "")]
    for k, (kind, name) in enumerate(tasks):
        given.announce(name or "training rooms", k / len(tasks))
        if name:
            found.append(places_along(name, kind, places))
        else:
            found.append(_in_training_rooms(kind, rooms, places // rooms))
    given.announce("statistics", 0.9)
    rows = [_row(place) for place in found]
    given.announce("done", 1.0)
    return Finding(rows, _page(found, rows))


def measured_places(folder: Path) -> list[Place]:
    """The measured room in two of its states; microphones 5 and 10 cm from the first."""
    found = []
    for circle, file in FILES.items():
        with np.load(folder / file, allow_pickle=False) as archive:
            rir = np.moveaxis(archive["rir"], 2, 3)[..., int(archive["direct_sample"]) :]
        for state, k in STATES.items():
            here = rir[k].astype(np.float64)
            moved = {0.025: here[:, 1]}
            found.append(Place(f"{circle}, {state}", "measured", here[:, 0], moved))
    return found


def places_along(name: str, kind: str, count: int, moved_m: Sequence[float] = MOVED_M) -> Place:
    """Phones that look along a world's route, and each moved so far."""
    world, generator = load_world(name), np.random.default_rng(0)
    corners = np.vstack([world.route_m, world.route_m[:1]])
    legs = np.diff(corners, axis=0)
    at_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(legs, axis=1))])
    way = generator.uniform(0.0, at_m[-1], count)
    leg = np.searchsorted(at_m, way, side="right") - 1
    xy = np.column_stack([np.interp(way, at_m, corners[:, axis]) for axis in range(2)])
    yaw = np.arctan2(legs[leg, 1], legs[leg, 0])
    return _heard(name.replace("_", " "), kind, world.room, xy, yaw, generator, moved_m)


def _in_training_rooms(kind: str, rooms: int, places: int) -> Place:
    """Phones in rooms that encoders are trained in."""
    parts = []
    for k in range(rooms):
        generator = np.random.default_rng([9, k])
        room = random_room(generator)
        tried = room.corner_m + generator.uniform(0, 1, (400, 2)) * room.size_m[:2]
        xy = tried[room.is_free(tried, 1.2, 0.3)][:places]
        yaw = generator.uniform(-np.pi, np.pi, len(xy))
        parts.append(_heard("", kind, room, xy, yaw, generator, MOVED_M))
    moved = {far: np.concatenate([part.moved[far] for part in parts]) for far in MOVED_M}
    name = f"{rooms} training rooms"
    return Place(name, KINDS[kind], np.concatenate([part.responses for part in parts]), moved)


def _heard(
    name: str,
    kind: str,
    room: Room,
    xy_m: F64,
    yaw_rad: F64,
    generator: np.random.Generator,
    moved_m: Sequence[float],
) -> Place:
    """What flat phones hear there, and each moved by so much in some direction."""
    today = Circumstances(engine=kind)
    there = as_measured(room) if kind == "diffuse" else room
    scene, engine = scene_of(there), engine_of(today, there, 1)

    def responses(at_m: F64) -> F64:
        poses = poses_at(
            np.column_stack([at_m, np.full(len(at_m), 1.2)]), yaw_rad, np.full(len(at_m), 0.4)
        )
        device = built_in_device("flat")
        return response_of(room_responses(scene, device, poses, air_at(), reach_of(today), engine))

    angle = generator.uniform(-np.pi, np.pi, len(xy_m))
    step = np.column_stack([np.cos(angle), np.sin(angle)])
    moved = {far: responses(xy_m + far * step) for far in moved_m}
    return Place(name, KINDS[kind], responses(xy_m), moved, xy_m)


def response_of(envelopes: C64) -> F64:
    """Impulse responses (n, samples) at 48 kHz of complex envelopes (n, 630)."""
    size, first = round(RATE_HZ / BIN_HZ), round(BAND_LOW_HZ / BIN_HZ)
    spectrum = np.zeros((len(envelopes), size // 2 + 1), dtype=np.complex128)
    baseband = np.fft.fftshift(np.fft.fft(envelopes, axis=1), axes=1)
    spectrum[:, first : first + BAND_BINS] = baseband
    return np.asarray(np.fft.irfft(spectrum, size, axis=1))


def echoes_of(responses: F64) -> F32:
    """The echo (n, 2352) of a chirp through each response (n, samples)."""
    chirp = make_chirp(replace(ChirpParameters(), period_s=PERIOD_S), RATE_HZ)
    return np.stack([echo_of(response, chirp) for response in responses])


def _features(responses: F64) -> F32:
    return generic_encoders()["spectrogram without mean"].embed(echoes_of(responses))


def _row(place: Place) -> Row:
    band = banded(place.responses, RATE_HZ)
    here = _features(place.responses)
    row: Row = {"room": place.name, "sound": place.kind, "places": len(here)}
    shown = {"kurtosis": kurtosis(band, RATE_HZ), "spread (dB)": spread_db(band, RATE_HZ)}
    for what, values in shown.items():
        row[what] = " / ".join(f"{value:.1f}" for value in values)
    row["T60 (ms)"] = round(1000 * reverberation_s(band, RATE_HZ))
    for far in MOVED_M:
        moved = place.moved.get(far)
        kept = None if moved is None else round(contrast(here, _features(moved)), 2)
        row[_contrast_at(far)] = kept
    return row


def _contrast_at(far_m: float) -> str:
    return f"contrast {100 * far_m:g} cm"


def _page(places: list[Place], rows: list[Row]) -> Page:
    columns = ("room", "sound", "places", "kurtosis", "spread (dB)", "T60 (ms)")
    table = rows_table([{name: row[name] for name in columns} for row in rows])
    return Page(
        "Simulated rooms beside measured ones",
        "impulse responses between 15.2 and 19.8 kHz; windows of 11 to 20, 20 to 35, 35 to 60 ms",
        [
            *(_contrast_panel(kind, places, rows) for kind in KINDS.values()),
            Panel("Responses", table, "3 and 5.6 dB are a diffuse field.", wide=True),
        ],
    )


def _contrast_panel(kind: str, places: list[Place], rows: list[Row]) -> Panel:
    """Curves of the rooms of one kind of sound, and dots for the measured ones."""
    curves, measured = {}, []
    for place, row in zip(places, rows, strict=True):
        kept = [(100 * far, row[_contrast_at(far)]) for far in place.moved]
        if place.kind == "measured":
            measured += kept
        elif place.kind == kind:
            curves[place.name] = Curve(*np.array(kept, dtype=np.float64).T)
    ticks = [100 * far for far in MOVED_M]
    figure = curves_figure(curves, "phone moved (cm)", "contrast", ticks=ticks)
    figure.update_yaxes(range=[0, 1])
    figure.add_scatter(
        x=[far_cm for far_cm, _ in measured], y=[kept for _, kept in measured], name="measured",
        mode="markers", marker={"size": 10, "symbol": "diamond", "color": TRUTH},
    )  # fmt: skip
    return Panel(f"How fast an echo changes with the place: {kind}", figure, NOTE)
