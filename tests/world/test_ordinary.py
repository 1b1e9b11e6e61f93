"""Ordinary phones: what they have, how long they ring, and how far echoes are above their noise."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy import signal

from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.circumstances import Circumstances, device_of
from elfslam.world.device import Device, band_hz, random_device
from elfslam.world.diffuse import diffuse_echoes
from elfslam.world.phone import Engine, poses_at, render_frames, room_responses
from elfslam.world.pulses import SPEED_OF_SOUND_MPS
from elfslam.world.room import Room
from elfslam.world.scattering import as_measured, scattering_of
from elfslam.world.scene import scene_of
from elfslam.world.transducers import CONTROLLED_SHARE, HEARD_HZ, NOISE, ordinary_traits, ringing
from elfslam.world.world_file import load_world

RATE_HZ = 44_100
BUILT_IN = ("ordinary phone", "other ordinary phone")


def some_phones(count: int) -> list[Device]:
    generator = np.random.default_rng(4)
    return [random_device(generator, ordinary=True) for _ in range(count)]


@pytest.fixture(scope="module")
def studio() -> tuple[Room, Engine]:
    room = as_measured(load_world("studio").room)
    return room, partial(diffuse_echoes, scattering=scattering_of(room))


def echoes_over_noise_db(studio: tuple[Room, Engine], device: Device) -> float:
    """Between 15.2 and 19.8 kHz, 11 to 64 ms after the direct sound, in the median of places."""
    room, engine = studio
    generator = np.random.default_rng(0)
    xy = room.corner_m + generator.uniform(0.0, 1.0, (300, 2)) * room.size_m[:2]
    xy = xy[room.is_free(xy, 1.2, 0.3)][:24]
    poses = poses_at(np.column_stack([xy, np.full(len(xy), 1.2)]), xy[:, 0] * 7, 0 * xy[:, 0] + 0.4)
    chirp = make_chirp(ChirpParameters(), RATE_HZ)
    frames = render_frames(
        room_responses(scene_of(room), device, poses, engine=engine), chirp, device
    )
    band = signal.butter(6, (15_200, 19_800), "bandpass", fs=RATE_HZ, output="sos")
    noise = device.noise_rms * np.random.default_rng(1).standard_normal(frames.shape)
    direct_s = device.separation_m / SPEED_OF_SOUND_MPS
    window = slice(round((direct_s + 0.011) * RATE_HZ), round((direct_s + 0.064) * RATE_HZ))
    power = [
        np.mean(signal.sosfiltfilt(band, sound, axis=1)[:, window] ** 2, axis=1)
        for sound in (frames, noise)
    ]
    return float(np.median(10 * np.log10(power[0] / power[1])))


@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize(("volume", "low_db", "high_db"), [(1.0, 18, 25), (0.2, 5, 11)])
def test_the_volume_matters(
    studio: tuple[Room, Engine], name: str, volume: float, low_db: float, high_db: float
) -> None:
    device = device_of(Circumstances(device=name, volume=volume))
    assert low_db < echoes_over_noise_db(studio, device) < high_db


def test_random_ones_hear_as_much_of_their_noise(studio: tuple[Room, Engine]) -> None:
    over_db = [echoes_over_noise_db(studio, phone) for phone in some_phones(6)]
    assert 17 < np.median(over_db) < 26
    assert min(over_db) > 12
    assert max(over_db) < 30


def test_they_ring_for_tenths_of_a_millisecond() -> None:
    modes = [mode for phone in some_phones(30) for mode in phone.ringing]
    decays_s = np.array([mode.decay_s for mode in modes])
    assert 0.1e-3 <= decays_s.min() < 0.13e-3
    assert 0.37e-3 < decays_s.max() <= 0.4e-3
    assert all(HEARD_HZ[0] <= mode.frequency_hz <= HEARD_HZ[1] for mode in modes)
    assert {np.sign(mode.gain) for mode in modes} == {-1.0, 1.0}
    assert {len(phone.ringing) for phone in some_phones(30)} == {2, 3, 4}


def test_they_have_lobes_and_some_ride_their_gain() -> None:
    phones = some_phones(60)
    for phone in phones:
        assert 0.15 <= phone.speaker_lobes.share <= 0.4
        assert 0.05 <= phone.microphone_lobes.share <= 0.25
        assert np.linalg.norm(phone.speaker_lobes.axis) == pytest.approx(1.0)
    across = np.array([phone.speaker_lobes.axis for phone in phones])
    assert np.abs(across[:, 0]).mean() > 0.7
    assert np.abs(across[:, 1:]).mean() > 0.1
    controlled = np.mean([phone.gain_control is not None for phone in phones])
    assert controlled == pytest.approx(CONTROLLED_SHARE, abs=0.2)


def test_noise_follows_the_loudness_of_the_phone() -> None:
    quiet, loud = (
        ordinary_traits(np.random.default_rng(2), np.full(630, gain), band_hz())
        for gain in (1.0, 3.0)
    )
    assert loud["noise_rms"] == pytest.approx(3 * quiet["noise_rms"])
    assert loud["ringing"] == quiet["ringing"]
    heard = (band_hz() >= HEARD_HZ[0]) & (band_hz() <= HEARD_HZ[1])
    rms = np.sqrt(np.mean(np.abs(ringing(quiet["ringing"], band_hz()))[heard] ** 2))
    assert NOISE[0] <= quiet["noise_rms"] / rms <= NOISE[1]
