"""Simulated walks: the same seed gives the same bytes, and no truth slips into a recording."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_SAMPLES, Audio, Recording, Truth
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.line.echo import EchoParameters, cut_echoes, find_arrivals, matched_envelope
from elfslam.line.feature import SpectralEncoder
from elfslam.world.acoustics import image_sources, render_frames, room_responses
from elfslam.world.air import SPEED_OF_SOUND_MPS
from elfslam.world.device import named_device
from elfslam.world.room import Furniture
from elfslam.world.simulate import (
    LATENCY_S,
    World,
    describe_chirp,
    load_world,
    simulate,
    world_names,
)
from elfslam.world.walker import KINEMATICS_RATE_HZ, random_walker, walk

PERIOD_SAMPLES = 4410
WORLD_TOML = """
name = "closet"
size_m = [4.0, 3.0, 2.5]
reflection = [0.8, 0.8, 0.8, 0.8, 0.5, 0.7]
furniture_seed = 3
route_m = [[0.8, 0.8], [3.2, 0.8], [3.2, 2.2], [0.8, 2.2]]

[[furniture]]
name = "stool"
corner_m = [1.8, 1.3, 0.0]
size_m = [0.4, 0.4, 0.5]
"""


@pytest.fixture(scope="module")
def studio() -> World:
    return load_world("studio")


@pytest.fixture(scope="module")
def walked(studio: World) -> tuple[Recording, Truth]:
    return simulate(studio, 3, rounds=1)


def audio_of(recording: Recording) -> Audio:
    assert recording.audio is not None
    return recording.audio


def bytes_of(recording: Recording, truth: Truth) -> bytes:
    assert recording.imu is not None
    arrays = (
        audio_of(recording).samples,
        recording.imu.accel_mps2,
        recording.imu.gyro_radps,
        truth.world_from_body,
    )
    return b"".join(values.tobytes() for values in arrays)


def world_file(folder: Path, text: str) -> str:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


# --- worlds ---


def test_the_worlds_that_come_along() -> None:
    assert {"living_room", "office", "studio"} <= set(world_names())


def clearance_m(xy: F64, item: Furniture) -> float:
    """Least distance (along x or y) from points (n, 2) to a piece of furniture."""
    low, high = item.corner_m[:2], (item.corner_m + item.size_m)[:2]
    return float(np.maximum(low - xy, xy - high).max(axis=1).min())


@pytest.mark.parametrize("name", world_names())
def test_a_built_in_world_can_be_walked(name: str) -> None:
    """The route, walked with 10 cm of wander, stays off walls and furniture."""
    world = load_world(name)
    ends = np.roll(world.route_m, -1, axis=0)
    xy = np.vstack(np.linspace(world.route_m, ends, 200))
    assert world.name == name
    assert (xy > 0.5).all()
    assert (xy < world.room.size_m[:2] - 0.5).all()
    assert min(clearance_m(xy, item) for item in world.room.furniture) > 0.2


def test_the_living_room_of_the_paper_has_60_m2() -> None:
    assert load_world("living_room").room.size_m[:2].prod() == pytest.approx(60.0)
    assert load_world("office").room.size_m[:2].prod() == pytest.approx(360.0)


def test_a_world_is_the_same_every_time(studio: World) -> None:
    again = load_world("studio")
    assert (again.room.scatterers_m == studio.room.scatterers_m).all()


def test_a_world_from_a_file(tmp_path: Path) -> None:
    world = load_world(world_file(tmp_path, WORLD_TOML))
    assert world.name == "closet"
    assert world.room.furniture[0].name == "stool"
    assert world.route_m.shape == (4, 2)
    recording, truth = simulate(world, 0, rounds=1)
    assert recording.name == "closet seed 0"
    assert (truth.world_from_body[:, :2] > 0).all()
    assert (truth.world_from_body[:, :2] < [4.0, 3.0]).all()


def test_a_world_without_furniture(tmp_path: Path) -> None:
    world = load_world(world_file(tmp_path, WORLD_TOML.partition("[[furniture")[0]))
    assert len(world.room.scatterers_m) == 0


@pytest.mark.parametrize("name", ["garage", "", "../world", "no/such/file.toml"])
def test_an_unknown_world_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError, match=f"wanted {', '.join(world_names())} or a TOML file"):
        load_world(name)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("size_m = [4", "size_m = [4 4", "not a world description"),
        ('name = "closet"', "", r"not a world description \('name'\)"),
        ("furniture_seed = 3", 'furniture_seed = "three"', "not a world description"),
        ("furniture_seed = 3", "furniture_seed = -3", "not a world description"),
        ("[[0.8, 0.8], ", "[[0.8], ", "not a world description"),
        ("[4.0, 3.0, 2.5]", "[4.0, 3.0]", "not a world description"),
        ("0.5, 0.7]", "0.5]", r"Room.reflection: wanted shape \(6\)"),
        ("0.5, 0.7]", "0.5, 1.7]", "wanted six reflections from 0 to 1"),
        ('name = "stool"', 'title = "stool"', "not a world description"),
        ("[1.8, 1.3, 0.0]", "[3.8, 1.3, 0.0]", "furniture 'stool' stands outside the room"),
        ("[3.2, 2.2]", "[3.2, 3.2]", "world 'closet': the route leaves the room"),
    ],
)
def test_a_broken_world_is_refused(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    assert old in WORLD_TOML
    with pytest.raises(InputError, match=complaint) as refusal:
        load_world(world_file(tmp_path, WORLD_TOML.replace(old, new, 1)))
    assert "\n" not in str(refusal.value)


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xff\xfe\x00name")
    with pytest.raises(InputError, match="not a world description"):
        load_world(str(path))


# --- recordings ---


def test_the_same_seed_gives_the_same_bytes(studio: World, walked: tuple[Recording, Truth]) -> None:
    assert bytes_of(*simulate(studio, 3, rounds=1)) == bytes_of(*walked)
    assert bytes_of(*simulate(studio, 4, rounds=1)) != bytes_of(*walked)


def test_a_recording_holds_nothing_of_the_truth(walked: tuple[Recording, Truth]) -> None:
    recording, _ = walked
    brought = {item.name for item in fields(recording) if getattr(recording, item.name) is not None}
    assert brought == {"name", "device", "audio", "imu"}


def test_the_sound_fits_its_range(walked: tuple[Recording, Truth]) -> None:
    audio = audio_of(walked[0])
    assert audio.rate_hz == 44_100
    assert audio.samples.shape[0] == 1
    assert 0.05 < np.abs(audio.samples).max() <= 1.0


def test_all_clocks_run_equally_long(walked: tuple[Recording, Truth]) -> None:
    recording, truth = walked
    audio = audio_of(recording)
    duration_s = audio.samples.shape[1] / audio.rate_hz
    assert recording.imu is not None
    assert recording.imu.t_s[-1] == pytest.approx(duration_s, abs=0.02)
    assert truth.t_s[-1] == pytest.approx(duration_s, abs=0.04)
    assert truth.t_s[0] == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_the_line_finds_every_direct_sound(studio: World, seed: int) -> None:
    """One every 100 ms to the sample, at a latency of this run."""
    audio = audio_of(simulate(studio, seed, rounds=2)[0])
    chirp = make_chirp(ChirpParameters(), audio.rate_hz)
    envelope = matched_envelope(audio.samples[0], chirp)
    arrivals = find_arrivals(envelope, PERIOD_SAMPLES, EchoParameters())
    assert arrivals.jumps == ()
    assert np.abs(np.diff(arrivals.samples) - PERIOD_SAMPLES).max() <= 1
    first_s = arrivals.samples[0] / audio.rate_hz
    assert LATENCY_S[0] < first_s < LATENCY_S[1] + 0.001
    assert len(arrivals.samples) >= audio.samples.shape[1] // PERIOD_SAMPLES - 2


@pytest.mark.parametrize("moment_s", [1.0, 5.0, 9.0, 13.0])
def test_every_chirp_is_heard_where_the_walker_was(
    studio: World, walked: tuple[Recording, Truth], moment_s: float
) -> None:
    """The same walker on the same walk, and the room's answer at one moment of it."""
    generator = np.random.default_rng([3, 1])
    walker = random_walker(generator)
    motion = walk(walker, studio.route_m, 1, generator)
    assert (walked[1].world_from_body[:, :2] == motion.position_m[::8, :2]).all()
    audio = audio_of(walked[0])
    chirp, device = make_chirp(ChirpParameters(), audio.rate_hz), named_device("any")
    direct = cut_echoes(audio, chirp, EchoParameters())
    k = int(np.searchsorted(direct.t_s, moment_s))
    at = [int((direct.t_s[k] - device.separation_m / SPEED_OF_SOUND_MPS) * KINEMATICS_RATE_HZ)]
    responses = room_responses(
        studio.room,
        image_sources(studio.room),
        device,
        motion.position_m[at],
        motion.yaw_rad[at],
        motion.pitch_rad[at],
        np.array([walker.body_distance_m]),
    )
    frame = render_frames(responses, chirp, device)[0]
    high = signal.butter(6, 13_000, "highpass", fs=audio.rate_hz, output="sos")
    heard = signal.sosfiltfilt(high, direct.samples[k])
    likeness = []
    for start in range(DISCARDED_SAMPLES, DISCARDED_SAMPLES + 40):
        expected = frame[start : start + ECHO_SAMPLES]
        likeness.append(np.corrcoef(expected, heard)[0, 1])
    assert np.argmax(likeness) == pytest.approx(19.3, abs=1.5), "the way of the direct sound"
    assert max(likeness) > 0.9


def test_every_run_has_its_own_latency(studio: World) -> None:
    chirp = make_chirp(ChirpParameters(), 44_100)
    latencies = set()
    for seed in range(4):
        samples = audio_of(simulate(studio, seed, rounds=1)[0]).samples[0]
        latencies.add(int(matched_envelope(samples[: 2 * PERIOD_SAMPLES], chirp).argmax()))
    assert len(latencies) == 4


def test_both_rates_hear_the_same_walk(studio: World, walked: tuple[Recording, Truth]) -> None:
    recording, truth = simulate(studio, 3, rounds=1, rate_hz=48_000)
    audio = audio_of(recording)
    assert audio.rate_hz == 48_000
    assert truth.world_from_body.tobytes() == walked[1].world_from_body.tobytes()
    slow, fast = (
        cut_echoes(heard, make_chirp(ChirpParameters(), heard.rate_hz), EchoParameters())
        for heard in (audio_of(walked[0]), audio)
    )
    assert np.abs(slow.t_s - fast.t_s).max() < 1e-4
    encoder = SpectralEncoder()
    cosine = np.sum(encoder.embed(slow.samples) * encoder.embed(fast.samples), axis=1)
    assert np.median(cosine) > 0.9


def test_a_lap_begins_and_ends_at_the_same_place(walked: tuple[Recording, Truth]) -> None:
    poses = walked[1].world_from_body
    assert np.linalg.norm(poses[-1, :2] - poses[0, :2]) < 0.5
    assert np.ptp(poses[:, 0]) > 4.0


def test_the_other_way_round(studio: World) -> None:
    """The studio's route runs counter-clockwise."""
    turned = []
    for reverse in (False, True):
        heading = simulate(studio, 1, rounds=1, reverse=reverse)[1].world_from_body[:, 2]
        turned.append(heading[-1] - heading[0])
    assert turned == pytest.approx([2 * np.pi, -2 * np.pi], abs=0.2)


def test_progress_rises_to_the_end(studio: World) -> None:
    heard: list[float] = []
    simulate(studio, 0, rounds=2, progress=heard.append)
    assert len(heard) > 1
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


def test_the_chirp_is_described_as_it_was_played() -> None:
    chirp = make_chirp(ChirpParameters(), 44_100)
    described = describe_chirp()
    assert described["band_hz"] == chirp.band_hz.tolist()
    assert described["period_s"] == chirp.period_s
    assert described["duration_s"] == len(chirp.samples) / chirp.rate_hz
    assert described["kind"] == "chirp"


def test_other_rates_are_refused(studio: World) -> None:
    with pytest.raises(InputError, match="wanted 44100 or 48000 Hz, got 16000"):
        simulate(studio, 0, rounds=1, rate_hz=16_000)
