"""Phones: the ripple that was asked for, and built-in phones that never change."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base.errors import InputError
from elfslam.world.device import (
    BAND_BINS,
    BMI160,
    BROWSER,
    CHIRP_GAIN_DB,
    DEVICES,
    GRADES,
    HEARING,
    ICM20948,
    LSM6DSO,
    MEASURED,
    Device,
    as_loud,
    band_hz,
    built_in_device,
    built_in_grade,
    named_device,
    random_device,
    smooth_response,
)
from elfslam.world.transducers import ringing

PINNED = {
    "simulated phone": [0.791577, 1.704771, 0.829358, 0.544091],
    "flat": [1.0, 1.0, 1.0, 1.0],
    "rippled": [9.269088, 2.064854, 0.326527, 1.1456],
    "cheap": [0.916844, 0.976849, 0.552415, 0.084549],
    "tablet": [1.938015, 0.451567, 1.189571, 2.539347],
    "bottom-fired": [1.07837, 2.038577, 0.572359, 0.741531],
    "ordinary phone": [2.051283, 1.082757, 0.687397, 0.715746],
    "other ordinary phone": [1.649372, 0.704209, 1.961191, 0.57631],
}
"""Responses at bins 0, 200, 400 and 629."""
ORDINARY = (
    "ringing", "speaker_lobes", "microphone_lobes", "gain_control", "near_field",
    "direct_gain", "level", "noise_rms",
)  # fmt: skip


@given(seed=st.integers(0, 2**32 - 1), ripple_db=st.floats(0.5, 30.0))
def test_the_ripple_is_the_one_asked_for(seed: int, ripple_db: float) -> None:
    response = smooth_response(np.random.default_rng(seed), ripple_db)
    level_db = 20 * np.log10(response)
    assert response.shape == (BAND_BINS,)
    assert np.ptp(level_db) == pytest.approx(ripple_db, rel=1e-9)
    assert level_db.mean() == pytest.approx(0.0, abs=1e-9)
    assert np.abs(np.diff(level_db)).max() < 0.06 * ripple_db


@pytest.mark.parametrize("name", PINNED)
def test_the_built_in_phones_are_fixed_for_all_time(name: str) -> None:
    phone = built_in_device(name)
    assert phone.name == name
    np.testing.assert_allclose(phone.response[[0, 200, 400, 629]], PINNED[name], rtol=1e-5)
    assert (named_device(name).response == phone.response).all()


def test_the_built_in_phones_differ_in_what_their_names_say() -> None:
    ripple_db = {name: ripple_of(built_in_device(name)) for name in DEVICES}
    assert ripple_db["flat"] == 0.0
    assert ripple_db["rippled"] == pytest.approx(30.0)
    assert built_in_device("tablet").separation_m == pytest.approx(0.24)
    assert 0.02 <= built_in_device("bottom-fired").separation_m <= 0.03
    assert (built_in_device("bottom-fired").speaker_axis == [0, -1, 0]).all()
    assert built_in_device("cheap").clock_skew_ppm == 20.0
    assert built_in_device("cheap").noise_rms > named_device("simulated phone").noise_rms


@pytest.mark.parametrize("name", DEVICES)
def test_no_built_in_phone_clips_its_own_direct_sound(name: str) -> None:
    """A chirp of full scale sweeps the band, so its peak follows the response and the ringing."""
    phone = built_in_device(name)
    chirped = slice(65, 565)
    gain = np.abs(phone.response * ringing(phone.ringing, band_hz()))[chirped].max()
    assert phone.level * phone.direct_gain / phone.separation_m * gain < phone.clip_level


def test_an_unknown_phone_gets_the_near_one() -> None:
    with pytest.raises(InputError, match=r"device 'tablett': .*did you mean 'tablet'\?"):
        built_in_device("tablett")
    with pytest.raises(InputError, match=r"device '42': .*choose one of them"):
        built_in_device("42")


def test_phones_that_cannot_be_are_refused() -> None:
    flat, centre = np.ones(BAND_BINS), np.zeros(3)
    with pytest.raises(InputError, match="at one place"):
        Device("odd", flat, speaker_m=centre, microphone_m=centre)
    with pytest.raises(InputError, match=r"Device\.speaker_axis: wanted rows of length 1"):
        Device("odd", flat, speaker_axis=np.array([0.0, 2.0, 0.0]))
    for wrong in ({"clip_level": 0.0}, {"noise_rms": -1e-5}, {"jitter_s": -1.0}, {"level": -1.0}):
        with pytest.raises(InputError, match="wanted a positive clip level"):
            Device("odd", flat, **wrong)


def test_random_phones_are_ordinary_when_asked() -> None:
    """What is not of ordinary phones alone is drawn as before."""
    generator, old = np.random.default_rng(3), np.random.default_rng(3)
    phone, plain = random_device(generator, ordinary=True), random_device(old)
    assert generator.uniform() == old.uniform()
    for item in fields(Device):
        if item.name not in ORDINARY:
            assert repr(getattr(phone, item.name)) == repr(getattr(plain, item.name))
    assert (len(phone.ringing) >= 2) > len(plain.ringing)
    assert phone.near_field is not None
    assert plain.near_field is None


def noise_over_direct_db(phone: Device) -> float:
    """Of a compressed chirp, over a flat phone's direct sound."""
    direct = phone.level * phone.direct_gain / phone.separation_m
    return float(20 * np.log10(phone.noise_rms / direct)) - CHIRP_GAIN_DB


@pytest.mark.parametrize("noise_db", [-60.0, -20.0, 25.0])
def test_a_phone_is_as_noisy_as_asked_for_within_full_scale(noise_db: float) -> None:
    flat = as_loud(built_in_device("flat"), -50.0, noise_db)
    assert noise_over_direct_db(flat) == pytest.approx(noise_db)
    direct = flat.level * flat.direct_gain / flat.separation_m
    assert direct + 4 * flat.noise_rms == pytest.approx(0.5)


def test_echoes_that_are_10_db_softer_have_a_direct_sound_10_db_louder() -> None:
    soft, loud = (as_loud(built_in_device("tablet"), echo_db, -40.0) for echo_db in (-60.0, -50.0))
    assert soft.direct_gain / loud.direct_gain == pytest.approx(10**0.5)


def test_drawn_phones_are_like_those_that_hear_the_room() -> None:
    """As far apart as the measured ones, and none of them as the one that hears nothing."""
    assert {each.setup for each in MEASURED.values()} > {each.setup for each in HEARING}
    generator = np.random.default_rng(6)
    phones = [random_device(generator, ordinary=True) for _ in range(400)]
    drawn_db = np.array([noise_over_direct_db(phone) for phone in phones])
    known_db = np.array([each.noise_db for each in HEARING])
    assert np.median(drawn_db) == pytest.approx(np.median(known_db), abs=4.0)
    assert np.ptp(np.quantile(drawn_db, [0.1, 0.9])) == pytest.approx(np.ptp(known_db), rel=0.3)


def test_random_phones_differ_in_geometry_and_clock() -> None:
    generator = np.random.default_rng(5)
    phones = [random_device(generator) for _ in range(60)]
    separation_m = [phone.separation_m for phone in phones]
    assert 0.10 <= min(separation_m) < 0.13
    assert 0.21 < max(separation_m) < 0.25
    skew_ppm = [phone.clock_skew_ppm for phone in phones]
    assert -30 <= min(skew_ppm) < -20
    assert 20 < max(skew_ppm) <= 30
    assert all(0 <= phone.jitter_s <= 20e-6 for phone in phones)


def ripple_of(phone: Device) -> float:
    return float(np.ptp(20 * np.log10(phone.response)))


def test_a_response_of_another_size_is_refused() -> None:
    with pytest.raises(InputError, match=r"Device\.response: wanted shape \(630\), got \(629,\)"):
        Device(name="short", response=np.ones(629))


def test_grades_are_those_of_their_data_sheets() -> None:
    """BST-BMI160-DS000: 7 mdps/rtHz, 180 ug/rtHz, 40 mg. DS12140: 3.8 mdps/rtHz, 70 ug/rtHz, 20 mg.
    DS-000189: 15 mdps/rtHz, 230 ug/rtHz, 25 mg."""
    stated = {BMI160: (0.007, 180, 40), LSM6DSO: (0.0038, 70, 20), ICM20948: (0.015, 230, 25)}
    for grade, (gyro_dps, accel_ug, offset_mg) in stated.items():
        assert np.rad2deg(grade.gyro_noise_radps_rthz) == pytest.approx(gyro_dps)
        assert grade.accel_noise_mps2_rthz / 9.80665e-6 == pytest.approx(accel_ug)
        assert grade.accel_bias_mps2 / 9.80665e-3 == pytest.approx(offset_mg)
        instability = np.rad2deg(grade.gyro_bias_instability_radps) * 3600
        assert instability == pytest.approx(10.0 * (grade is not BMI160))


def test_grades_are_known_by_short_names() -> None:
    assert {name: built_in_grade(name) for name in GRADES} == {
        "BMI160": BMI160, "LSM6DSO": LSM6DSO, "ICM20948": ICM20948, "browser": BROWSER,
    }  # fmt: skip
    with pytest.raises(InputError, match=r"imu 'ICM2094': wanted BMI160, .*mean 'ICM20948'"):
        built_in_grade("ICM2094")
