"""Similarity by mains hum: planted returns, both ways, and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Emr, Odometry
from elfslam.baselines.emr import EmrParameters, emr_similarity, hum_sequences

PARAMETERS = EmrParameters()


def walked_twice(*, back):
    """Fifty footsteps of random hum, then the same again in order or in reverse."""
    once = np.exp(np.random.default_rng(2).normal(size=(51, 3)))
    amplitude = np.vstack([once, once[::-1] if back else once])
    t_s = np.arange(len(amplitude), dtype=float)
    walk = Odometry(t_s, np.zeros((len(t_s), 3)), np.full((len(t_s) - 1, 3), 0.1))
    return Emr(t_s, amplitude), walk


@pytest.mark.parametrize("back", [False, True])
def test_a_stretch_is_found_again_either_way(back):
    scores = emr_similarity(*walked_twice(back=back), PARAMETERS).scores
    rows = np.arange(10, 40)
    best = 51 + np.argmax(scores[rows, 51:], axis=1)
    assert best.tolist() == ((100 - rows) if back else (rows + 51)).tolist()
    assert scores[rows, best].min() > 0.99


def test_a_louder_grid_changes_little():
    emr, walk = walked_twice(back=False)
    quiet = replace(PARAMETERS, quiet_uv=1e-6)
    louder = Emr(emr.t_s, 2.0 * emr.amplitude)
    assert hum_sequences(louder, walk, quiet) == pytest.approx(
        hum_sequences(emr, walk, quiet), abs=1e-4
    )


def test_hum_that_was_not_recorded_is_refused():
    emr, walk = walked_twice(back=False)
    with pytest.raises(InputError, match="EMR: got 0 samples between"):
        emr_similarity(Emr(emr.t_s + 1000.0, emr.amplitude), walk, PARAMETERS)
