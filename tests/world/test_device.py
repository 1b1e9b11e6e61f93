"""Phones: the ripple that was asked for, and one named phone that never changes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base.errors import InputError
from elfslam.world.device import (
    BAND_BINS,
    BAND_LOW_HZ,
    BIN_HZ,
    BMI160,
    BROWSER,
    ICM20948,
    LSM6DSO,
    Device,
    named_device,
    smooth_response,
)


@given(seed=st.integers(0, 2**32 - 1), ripple_db=st.floats(0.5, 30.0))
def test_the_ripple_is_the_one_asked_for(seed: int, ripple_db: float) -> None:
    response = smooth_response(np.random.default_rng(seed), ripple_db)
    level_db = 20 * np.log10(response)
    assert response.shape == (BAND_BINS,)
    assert np.ptp(level_db) == pytest.approx(ripple_db, rel=1e-9)
    assert level_db.mean() == pytest.approx(0.0, abs=1e-9)
    assert np.abs(np.diff(level_db)).max() < 0.06 * ripple_db


def test_the_named_phone_is_fixed_for_all_time() -> None:
    first, second = named_device("a"), named_device("b")
    assert (first.response == second.response).all()
    assert np.ptp(20 * np.log10(first.response)) == pytest.approx(10.0)
    expected = [0.791577, 1.70477, 0.829358, 0.544091]
    np.testing.assert_allclose(first.response[[0, 200, 400, 629]], expected, rtol=1e-5)


def test_the_band_holds_the_chirp() -> None:
    assert BAND_LOW_HZ < 15_000
    assert BAND_LOW_HZ + BAND_BINS * BIN_HZ > 20_000


def test_a_response_of_another_size_is_refused() -> None:
    with pytest.raises(InputError, match=r"Device\.response: wanted shape \(630\), got \(629,\)"):
        Device(name="short", response=np.ones(629))


def test_the_grade_is_the_one_of_the_data_sheet() -> None:
    """BST-BMI160-DS000: 0.007 deg/s/rtHz, 180 ug/rtHz, 40 mg."""
    assert np.rad2deg(BMI160.gyro_noise_radps_rthz) == pytest.approx(0.007)
    assert BMI160.accel_noise_mps2_rthz == pytest.approx(1.765e-3, rel=1e-3)
    assert BMI160.accel_bias_mps2 == pytest.approx(0.392, rel=1e-2)


def test_the_other_grades_are_those_of_their_data_sheets() -> None:
    """DS12140: 3.8 mdps/rtHz, 70 ug/rtHz, 20 mg. DS-000189: 15 mdps/rtHz, 230 ug/rtHz, 25 mg."""
    stated = {LSM6DSO: (0.0038, 70, 20), ICM20948: (0.015, 230, 25)}
    for grade, (gyro_dps, accel_ug, offset_mg) in stated.items():
        assert np.rad2deg(grade.gyro_noise_radps_rthz) == pytest.approx(gyro_dps)
        assert grade.accel_noise_mps2_rthz / 9.80665e-6 == pytest.approx(accel_ug)
        assert grade.accel_bias_mps2 / 9.80665e-3 == pytest.approx(offset_mg)
        assert np.rad2deg(grade.gyro_bias_instability_radps) * 3600 == pytest.approx(10.0)


def test_the_first_grade_has_not_changed() -> None:
    assert BMI160.gyro_bias_instability_radps == 0.0
    assert BMI160.decimals is None


def test_a_browser_is_slow_and_rounds() -> None:
    assert (BROWSER.rate_hz, BROWSER.decimals) == (60.0, 1)
    assert BROWSER.gyro_noise_radps_rthz == BMI160.gyro_noise_radps_rthz
