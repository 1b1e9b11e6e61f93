"""The stability of spectra: planted ones, and a few spots of the lab."""

import numpy as np

from studies.stability import (
    AGE,
    ELSEWHERE,
    HEIGHT,
    LEVEL,
    PLACE,
    WHOLE,
    YAW,
    compared,
    compared_elsewhere,
    measure_stability,
)
from studies.study import StudyContext

SPECTRA_DB = np.random.default_rng(0).normal(-40, 3, (5, 71))


def test_a_louder_spectrum_correlates_all_the_same() -> None:
    found = compared(SPECTRA_DB, SPECTRA_DB + 3.0)
    np.testing.assert_allclose(found[WHOLE], 1.0)
    np.testing.assert_allclose(found[PLACE], 1.0)
    np.testing.assert_allclose(found[LEVEL], 3.0)


def test_what_all_spots_share_is_the_phones() -> None:
    phone = 20 * np.sin(np.linspace(0, 3, 71))
    elsewhere = compared_elsewhere(SPECTRA_DB + phone)
    assert elsewhere[WHOLE].min() > 0.5
    assert elsewhere[PLACE].max() < 0.1
    assert elsewhere[LEVEL].shape == (5,)


def test_a_spot_is_itself_again_and_not_another() -> None:
    records = measure_stability(StudyContext(), spots=6)
    means = {(each.condition, each.metric): each.value for each in records}
    for first in (f"100 {HEIGHT}", f"0 {YAW}", f"0 {AGE}"):
        for metric in (WHOLE, PLACE):
            assert means[first, metric] > means[ELSEWHERE, metric] + 0.005
        assert means[first, LEVEL] < means[ELSEWHERE, LEVEL]
    assert means[f"180 {YAW}", PLACE] < means[f"10 {YAW}", PLACE]
    assert means[f"30 {AGE}", PLACE] > means[f"180 {YAW}", PLACE]
    spectrum = [each for each in records if each.method == f"40 {YAW}"]
    assert (spectrum[0].condition, spectrum[-1].condition) == ("15 kHz", "20.25 kHz")
