"""Similarity by the field and by mains hum: naive oracles, planted returns, real walks."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Emr, Magnetometer, Odometry, Orientation
from elfslam.baselines import magnetic
from elfslam.baselines.emr import EmrParameters, emr_similarity, hum_sequences
from elfslam.data.magnetic import read_magnetic
from elfslam.stages.motion import nodes_by_distance

PARAMETERS = magnetic.MagneticParameters()
SPEED_MPS = 1.0
FIELD_RATE_HZ = 20.0


def corridor_field(x_m):
    """The world field (n, 3) along a corridor, smooth and different everywhere in 0 to 40 m."""
    generator = np.random.default_rng(3)
    waves = generator.uniform(0.15, 0.6, (6, 3)), generator.uniform(0, 7, (6, 3))
    bent = np.sin(2 * np.pi * waves[0] * x_m[:, None, None] + waves[1]).sum(axis=1)
    return np.array([15.0, 0.0, -42.0]) + 4.0 * bent


def about_vertical(angle_rad):
    return Rotation.from_rotvec(np.outer(angle_rad, [0.0, 0.0, 1.0]))


def there_and(back, *, mounting=None, noise_ut=0.2, bias_ut=(0.0, 0.0, 0.0), pace=1.0):
    """A corridor walked twice: 30 m, then the same way again, or back the other way.

    `pace` is the speed of the second pass over that of the first. Returns field, attitude, nodes.
    """
    half_s = 30.0 / SPEED_MPS
    t_s = np.arange(0.0, half_s * (1 + 1 / pace), 1 / FIELD_RATE_HZ)
    second = t_s >= half_s
    progress_m = np.where(second, (t_s - half_s) * SPEED_MPS * pace, t_s * SPEED_MPS)
    x_m = np.where(second & back, 30.0 - progress_m, progress_m)
    yaw = about_vertical(np.where(second & back, np.pi, 0.0))
    attitude = yaw * (mounting or Rotation.identity())
    field = attitude.inv().apply(corridor_field(x_m)) + np.asarray(bias_ut)
    field = field + np.random.default_rng(1).normal(0.0, noise_ut, field.shape)
    odometer_m = np.where(second, 30.0 + progress_m, progress_m)
    nodes_t_s = np.interp(np.arange(0.0, 60.0, 0.5), odometer_m, t_s)
    poses = np.column_stack([np.arange(0.0, 60.0, 0.5), *np.zeros((2, 120))])
    nodes = Odometry(nodes_t_s, poses, np.full((119, 3), 0.05))
    return Magnetometer(t_s, field), Orientation(t_s, attitude.as_quat()), nodes


def naive_cost(one, other, band):
    """Dynamic time warping straight from its recursive definition."""

    @cache
    def best(i, j):
        if (i, j) == (-1, -1):
            return 0.0
        if min(i, j) < 0 or abs(i - j) > band:
            return np.inf
        before = min(best(i - 1, j), best(i, j - 1), best(i - 1, j - 1))
        return np.linalg.norm(one[i] - other[j]) + before

    return best(len(one) - 1, len(other) - 1) / len(one)


@pytest.mark.parametrize("band", [0, 1, 3, 9])
@pytest.mark.parametrize("components", [1, 3])
def test_warping_agrees_with_the_naive_recursion(band, components):
    generator = np.random.default_rng(band)
    windows, others = (generator.normal(size=(k, 9, components)) for k in (4, 5))
    wanted = [[naive_cost(one, other, band) for other in others] for one in windows]
    assert magnetic.warping_costs(windows, others, band) == pytest.approx(np.array(wanted))


def test_a_repeated_stretch_is_found_where_it_was_planted():
    scores = magnetic.magnetic_similarity(*there_and(False), PARAMETERS).scores
    rows = np.arange(5, 50)
    far = np.abs(np.subtract.outer(np.arange(119), np.arange(119))) >= 12
    best = np.argmax(np.where(far, scores, 0.0), axis=1)
    assert np.abs(best[rows] - (rows + 60)).max() <= 1
    assert scores[rows, rows + 60].min() > 0.6
    assert np.median(scores[far]) < 0.3


def test_a_stretch_walked_back_is_found_turned_round():
    scores = magnetic.magnetic_similarity(*there_and(True), PARAMETERS).scores
    rows = np.arange(5, 50)
    assert scores[rows, 119 - rows].min() > 0.6


def test_scores_are_symmetric_bounded_and_one_for_a_stretch_and_itself():
    scores = magnetic.magnetic_similarity(*there_and(False), PARAMETERS).scores
    assert scores == pytest.approx(scores.T)
    assert np.diag(scores) == pytest.approx(1.0)
    assert scores.min() >= 0.0
    assert scores.max() <= 1.0


@pytest.mark.parametrize("back", [False, True])
def test_the_magnetism_of_the_phone_changes_nothing(back):
    clean = magnetic.magnetic_similarity(*there_and(back), PARAMETERS).scores
    turned = there_and(back, bias_ut=(20.0, -35.0, 8.0))
    biased = magnetic.magnetic_similarity(*turned, PARAMETERS).scores
    assert biased == pytest.approx(clean, abs=1e-5)


def test_the_strength_of_the_field_does_not_matter():
    magnetometer, orientation, nodes = there_and(False)
    stronger = Magnetometer(magnetometer.t_s, 3.0 * magnetometer.field_ut)
    here, there = (
        magnetic.magnetic_similarity(field, orientation, nodes, PARAMETERS).scores
        for field in (magnetometer, stronger)
    )
    assert there == pytest.approx(here, abs=1e-5)


def test_levelling_undoes_roll_and_pitch():
    tilt = Rotation.from_euler("xy", [30, 25], degrees=True)
    flat_field, flat_attitude, _ = there_and(False, noise_ut=0.0)
    tilted_field, tilted_attitude, _ = there_and(False, noise_ut=0.0, mounting=tilt)
    flat = magnetic.levelled_field(flat_field, flat_attitude)
    tilted = magnetic.levelled_field(tilted_field, tilted_attitude)
    assert tilted[:, 2] == pytest.approx(flat[:, 2])
    assert np.hypot(*tilted[:, :2].T) == pytest.approx(np.hypot(*flat[:, :2].T))


def test_yaw_drift_of_the_orientation_changes_nothing():
    magnetometer, orientation, _ = there_and(True)
    drift = about_vertical(np.linspace(0, 2, len(orientation.t_s)))
    drifted = (drift * Rotation.from_quat(np.array(orientation.world_from_phone))).as_quat()
    here = magnetic.levelled_field(magnetometer, orientation)
    there = magnetic.levelled_field(magnetometer, Orientation(orientation.t_s, drifted))
    assert there == pytest.approx(here)


def test_without_orientation_the_magnitude_serves():
    magnetometer, _, nodes = there_and(False)
    windows = magnetic.field_sequences(magnetometer, None, nodes, PARAMETERS)
    assert windows.shape == (119, 17, 1)
    scores = magnetic.magnetic_similarity(magnetometer, None, nodes, PARAMETERS).scores
    rows = np.arange(5, 50)
    assert scores[rows, rows + 60].min() > 0.6


def test_a_magnetometer_that_slept_through_the_walk_is_refused():
    magnetometer, orientation, nodes = there_and(False)
    late = Magnetometer(magnetometer.t_s + 1000.0, magnetometer.field_ut)
    with pytest.raises(InputError, match="got 0 samples"):
        magnetic.magnetic_similarity(late, orientation, nodes, PARAMETERS)


def test_returns_of_a_real_walk_are_told_from_other_places(shared_data):
    path = shared_data / "magnetic" / "eight.mat"
    recording, truth = read_magnetic(path, np.random.default_rng(0))
    nodes = nodes_by_distance(recording.odometry, 0.5)
    field, attitude = recording.magnetometer, recording.orientation
    similarity = magnetic.magnetic_similarity(field, attitude, nodes, PARAMETERS)
    middle_s = (nodes.t_s[1:] + nodes.t_s[:-1]) / 2
    xy_m = interpolate_poses(truth.t_s, truth.world_from_body, middle_s)[:, :2]
    i, j = np.triu_indices(len(xy_m), 12)
    same_place = np.linalg.norm(xy_m[i] - xy_m[j], axis=1) < 1.0
    candidate = similarity.scores[i, j] >= 0.4
    assert same_place[candidate].mean() > 0.9
    assert candidate[same_place].mean() > 0.5


HUM = EmrParameters()


def walked_twice(*, back):
    """Fifty footsteps of random hum, then the same again in order or in reverse."""
    once = np.exp(np.random.default_rng(2).normal(size=(51, 3)))
    amplitude = np.vstack([once, once[::-1] if back else once])
    t_s = np.arange(len(amplitude), dtype=float)
    walk = Odometry(t_s, np.zeros((len(t_s), 3)), np.full((len(t_s) - 1, 3), 0.1))
    return Emr(t_s, amplitude), walk


@pytest.mark.parametrize("back", [False, True])
def test_a_stretch_is_found_again_either_way(back):
    scores = emr_similarity(*walked_twice(back=back), HUM).scores
    rows = np.arange(10, 40)
    best = 51 + np.argmax(scores[rows, 51:], axis=1)
    assert best.tolist() == ((100 - rows) if back else (rows + 51)).tolist()
    assert scores[rows, best].min() > 0.99


def test_a_louder_grid_changes_little():
    emr, walk = walked_twice(back=False)
    quiet = replace(HUM, quiet_uv=1e-6)
    louder = Emr(emr.t_s, 2.0 * emr.amplitude)
    one, other = (hum_sequences(each, walk, quiet) for each in (louder, emr))
    assert one == pytest.approx(other, abs=1e-4)


def test_hum_that_was_not_recorded_is_refused():
    emr, walk = walked_twice(back=False)
    with pytest.raises(InputError, match="EMR: got 0 samples between"):
        emr_similarity(Emr(emr.t_s + 1000.0, emr.amplitude), walk, HUM)
