"""Simulated walks: the same seed gives the same bytes, and no truth slips into a recording."""

from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy import signal

from elfslam.base.errors import InputError
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_SAMPLES, Audio, Recording, Truth
from elfslam.stages import echo
from elfslam.stages.chirp import ChirpParameters, describe_chirp, make_chirp
from elfslam.stages.feature import SpectralEncoder
from elfslam.world.circumstances import Circumstances
from elfslam.world.device import ICM20948, built_in_device
from elfslam.world.phone import Poses, air_at, phone_axes, render_frames, room_responses
from elfslam.world.recorder import LATENCY_S
from elfslam.world.scene import scene_of
from elfslam.world.simulate import simulate
from elfslam.world.walker import KINEMATICS_RATE_HZ, random_walker, walk
from elfslam.world.world_file import World, load_world

JITTERED, SOFTER = {"jitter_s": 0.025}, {"softer_db": 4.0}
CHANGED: tuple[dict[str, Any], ...] = (
    {"state": "moved", "day": 30, "people": 5, "other_phones": 1},
    {"device": "tablet", "volume": 0.3, "sounds": ("speech", "clicks")},
    JITTERED,
    SOFTER,
)


@pytest.fixture(scope="module")
def studio() -> World:
    return load_world("studio")


@cache
def walked_in(**circumstances: Any) -> tuple[Recording, Truth]:
    """A lap of the studio by seed 3."""
    return simulate(load_world("studio"), 3, rounds=1, circumstances=Circumstances(**circumstances))


@pytest.fixture
def walked() -> tuple[Recording, Truth]:
    return walked_in()


def bytes_of(recording: Recording, truth: Truth) -> bytes:
    imu = recording.imu.accel_mps2, recording.imu.gyro_radps
    arrays = (recording.audio.samples, *imu, truth.world_from_body)
    return b"".join(values.tobytes() for values in arrays)


def test_chirps_are_played_within_their_periods_when_the_recording_says() -> None:
    recording, _ = walked_in(**JITTERED)
    played_s = recording.played_t_s
    assert played_s is not None
    offset_s = played_s - 0.1 * np.arange(len(played_s))
    assert 0 <= offset_s.min() < 0.002
    assert 0.023 < offset_s.max() <= 0.0251
    assert abs(np.corrcoef(offset_s[1:], offset_s[:-1])[0, 1]) < 0.2
    chirp = make_chirp(ChirpParameters(), 44_100)
    echoes = echo.cut_echoes(recording.audio, chirp, echo.EchoParameters(), played_t_s=played_s)
    assert len(echoes.t_s) == len(played_s)
    late_s = echoes.t_s - played_s
    assert LATENCY_S[0] < late_s.mean() < LATENCY_S[1] + 0.001
    assert np.ptp(late_s) < 2 / 44_100


def test_chirps_are_softer_by_chance_and_the_recording_says_which() -> None:
    recording, _ = walked_in(**SOFTER)
    gain_db, played_s = recording.gain_db, recording.played_t_s
    assert played_s is not None
    assert set(gain_db.tolist()) == {0.0, -4.0}
    assert 0.4 < np.mean(gain_db == 0) < 0.6
    chirp = make_chirp(ChirpParameters(), 44_100)
    frames = echo.find_frames(recording.audio, chirp, echo.EchoParameters(), played_s)
    level_db = 20 * np.log10(echo.frame_facts(frames, echo.EchoParameters()).level)
    assert np.polyfit(gain_db, level_db, 1)[0] == pytest.approx(1.0, abs=0.05)


def test_the_same_seed_gives_the_same_bytes(studio: World, walked: tuple[Recording, Truth]) -> None:
    assert bytes_of(*simulate(studio, 3, rounds=1)) == bytes_of(*walked)
    assert bytes_of(*simulate(studio, 4, rounds=1)) != bytes_of(*walked)


def test_a_recording_holds_nothing_of_the_truth(walked: tuple[Recording, Truth]) -> None:
    recording, _ = walked
    brought = {item.name for item in fields(recording) if getattr(recording, item.name)}
    assert brought == {"name", "device", "audio", "imu"}
    assert (recording.name, recording.device) == ("studio", "simulated phone, Bosch BMI160")


def test_a_recording_tells_the_phone_and_no_other_circumstance(studio: World) -> None:
    busy = Circumstances("moved", 30, 4, "tablet", 0.4, ("music",), 1)
    recording, _ = simulate(studio, 77, rounds=1, circumstances=busy, grade=ICM20948, sound=False)
    assert recording.name == "studio"
    assert recording.device == "tablet, TDK InvenSense ICM-20948"


@pytest.mark.parametrize("changed", CHANGED)
def test_they_change_sound_alone(walked: tuple[Recording, Truth], changed: dict[str, Any]) -> None:
    recording, truth = walked_in(**changed)
    before, after = walked[0], recording
    assert truth.t_s.tobytes() == walked[1].t_s.tobytes()
    assert truth.world_from_body.tobytes() == walked[1].world_from_body.tobytes()
    assert after.imu.accel_mps2.tobytes() == before.imu.accel_mps2.tobytes()
    assert after.imu.gyro_radps.tobytes() == before.imu.gyro_radps.tobytes()
    assert after.audio.samples.shape == before.audio.samples.shape
    assert (after.audio.samples != before.audio.samples).any()


def test_all_clocks_run_equally_long(walked: tuple[Recording, Truth]) -> None:
    recording, truth = walked
    audio = recording.audio
    duration_s = audio.samples.shape[1] / audio.rate_hz
    assert recording.imu.t_s[-1] == pytest.approx(duration_s, abs=0.02)
    assert truth.t_s[-1] == pytest.approx(duration_s, abs=0.04)
    assert truth.t_s[0] == 0.0


@pytest.mark.parametrize("moment_s", [1.0, 5.0, 9.0, 13.0])
def test_every_chirp_is_heard_where_the_walker_was(
    studio: World, walked: tuple[Recording, Truth], moment_s: float
) -> None:
    """The same walker on the same walk, and the room's answer at one moment of it."""
    assert studio.climate.temperature_c is None
    generator = np.random.default_rng([3, 1])
    walker = random_walker(generator)
    motion = walk(walker, studio.route_m, 1, generator)
    assert (walked[1].world_from_body[:, :2] == motion.position_m[::8, :2]).all()
    audio = walked[0].audio
    chirp, device = make_chirp(ChirpParameters(), audio.rate_hz), built_in_device("simulated phone")
    direct = echo.cut_echoes(audio, chirp, echo.EchoParameters())
    k = int(np.searchsorted(direct.t_s, moment_s))
    at = [int((direct.t_s[k] - device.separation_m / air_at().speed_mps) * KINEMATICS_RATE_HZ)]
    speed = np.gradient(motion.position_m, 1 / KINEMATICS_RATE_HZ, axis=0)
    axes = phone_axes(motion.yaw_rad[at], motion.pitch_rad[at], motion.roll_rad[at])
    body = np.array([walker.body_distance_m])
    poses = Poses(motion.position_m[at], axes, speed[at], body, np.zeros((1, 0, 2)))
    responses = room_responses(scene_of(studio.room), device, poses)
    frame = render_frames(responses, chirp, device)[0]
    high = signal.butter(6, 13_000, "highpass", fs=audio.rate_hz, output="sos")
    heard = signal.sosfiltfilt(high, direct.samples[k])
    likeness = []
    for start in range(DISCARDED_SAMPLES, DISCARDED_SAMPLES + 40):
        expected = frame[start : start + ECHO_SAMPLES]
        likeness.append(np.corrcoef(expected, heard)[0, 1])
    assert np.argmax(likeness) == pytest.approx(19.3, abs=1.5), "the way of the direct sound"
    assert max(likeness) > 0.9


def test_nothing_but_the_sound_tells_how_warm_it_is() -> None:
    """Nor which doors are open: the line gets what a phone would know."""
    drawn, lived_in = walked_in(), walked_in(lived_in=True)
    assert (drawn[0].audio.samples != lived_in[0].audio.samples).any()
    for item in fields(Recording):
        if item.name != "audio":
            assert repr(getattr(drawn[0], item.name)) == repr(getattr(lived_in[0], item.name))
    assert (drawn[1].world_from_body == lived_in[1].world_from_body).all()
    named = {item.name for kind in (Recording, Audio) for item in fields(kind)}
    assert not any(word in name for name in named for word in ("temperature", "door", "air"))


def test_both_rates_hear_the_same_walk(studio: World, walked: tuple[Recording, Truth]) -> None:
    recording, truth = simulate(studio, 3, rounds=1, rate_hz=48_000)
    audio = recording.audio
    assert audio.rate_hz == 48_000
    assert truth.world_from_body.tobytes() == walked[1].world_from_body.tobytes()
    slow, fast = (
        echo.cut_echoes(heard, make_chirp(ChirpParameters(), heard.rate_hz), echo.EchoParameters())
        for heard in (walked[0].audio, audio)
    )
    assert np.abs(slow.t_s - fast.t_s).max() < 1e-4
    encoder = SpectralEncoder()
    cosine = np.sum(encoder.embed(slow.samples) * encoder.embed(fast.samples), axis=1)
    assert np.median(cosine) > 0.9


def test_the_other_way_round(studio: World) -> None:
    """The studio's route runs counter-clockwise."""
    turned = []
    for reverse in (False, True):
        truth = simulate(studio, 1, rounds=1, reverse=reverse, sound=False)[1]
        heading = truth.world_from_body[:, 2]
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


def test_a_walk_of_more_than_two_hours_is_refused_before_it_begins() -> None:
    world = load_world("studio")
    for rounds in (1_000_000_000, 10**400):
        with pytest.raises(InputError, match=r"rounds of .* walk fewer"):
            simulate(world, 0, rounds=rounds, sound=False)
