"""The scale of a walk from its sound: planted walls, laws, and honest refusals."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_RATE_HZ, ECHO_SAMPLES, Echoes, Odometry
from elfslam.slam.front_end import dead_reckoning_nodes, extract_echoes
from elfslam.slam.parameters import Parameters
from elfslam.stages import acoustic_odometry
from elfslam.stages.acoustic_odometry import UNKNOWN, ScaleEstimate, measure_scale, with_prior
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.motion import MotionParameters, dead_reckon
from elfslam.world.simulate import load_world, simulate

CHIRP = make_chirp(ChirpParameters(), ECHO_RATE_HZ)
PARAMETERS = acoustic_odometry.AcousticOdometryParameters(
    directions=24, smallest_scale=0.8, largest_scale=1.28, ahead_s=0.0
)
"""The planted walls below know no Doppler."""
SOUND_MPS = PARAMETERS.sound_mps
ROOM_M = (8.0, 6.5)
FRAMES = 270


def walked(t_s: F64) -> F64:
    """Positions (n, 2) on an ellipse in the room, at about 1.2 m/s."""
    angle = t_s * 1.2 / 2.0
    return np.column_stack([4.0 + 2.3 * np.cos(angle), 3.25 + 1.6 * np.sin(angle)])


def frames_at(xy_m: F64, noise: float = 0.05) -> Echoes:
    """What is heard between four walls at each position (n, 2), behind the direct sound."""
    x, y = xy_m.T
    path_m = 2.0 * np.column_stack([x, ROOM_M[0] - x, y, ROOM_M[1] - y])
    frequency_hz = np.fft.rfftfreq(8192, 1 / ECHO_RATE_HZ)
    played = np.fft.rfft(CHIRP.samples, 8192)
    turns = np.multiply.outer(path_m / SOUND_MPS, frequency_hz)
    heard = np.fft.irfft(np.exp(-2j * np.pi * turns).sum(axis=1) * played, axis=1)
    samples = heard[:, DISCARDED_SAMPLES : DISCARDED_SAMPLES + ECHO_SAMPLES]
    samples = samples + noise * np.random.default_rng(3).standard_normal(samples.shape)
    t_s = np.arange(len(xy_m)) / 10.0
    return Echoes(t_s, samples.astype(np.float32), np.zeros((0, 2)))


def claimed(scale: float, *, turned_rad: float = 0.0) -> Odometry:
    """Footsteps that claim the true moves over `scale`."""
    t_s = np.arange(0.0, 0.1 * FRAMES + 0.5, 0.5)
    cos, sin = np.cos(turned_rad), np.sin(turned_rad)
    turn = np.array([[cos, sin], [-sin, cos]])
    poses = np.column_stack([walked(t_s) @ turn / scale, np.zeros(len(t_s))])
    return Odometry(t_s, poses, np.full((len(t_s) - 1, 3), 0.1))


@pytest.fixture(scope="module")
def echoes() -> Echoes:
    return frames_at(walked(np.arange(FRAMES) / 10.0))


@pytest.mark.parametrize("scale", [0.88, 1.0, 1.15])
def test_a_planted_scale_is_found(echoes: Echoes, scale: float) -> None:
    found = measure_scale(echoes, claimed(scale), CHIRP, PARAMETERS)
    assert found.scale == pytest.approx(scale, rel=0.012)
    assert 0.0099 * scale < found.sigma < 0.03


def test_it_matters_not_where_the_map_lies(echoes: Echoes) -> None:
    straight = measure_scale(echoes, claimed(1.05), CHIRP, PARAMETERS)
    turned = measure_scale(echoes, claimed(1.05, turned_rad=1.1), CHIRP, PARAMETERS)
    assert turned.scale == pytest.approx(straight.scale, rel=0.01)


def test_faster_sound_makes_longer_steps(echoes: Echoes) -> None:
    fast = replace(PARAMETERS, sound_mps=1.04 * SOUND_MPS)
    slow, quick = (measure_scale(echoes, claimed(1.0), CHIRP, some) for some in (PARAMETERS, fast))
    assert quick.scale / slow.scale == pytest.approx(1.04, rel=0.01)


def test_a_chirp_at_48_khz_is_taken_to_the_echoes_rate(echoes: Echoes) -> None:
    other = make_chirp(ChirpParameters(), 48_000)
    scales = [measure_scale(echoes, claimed(1.0), at, PARAMETERS).scale for at in (CHIRP, other)]
    assert scales[0] == pytest.approx(scales[1], rel=2e-3)


def test_the_doppler_of_a_sweep_is_its_range_a_little_later() -> None:
    late = np.arange(FRAMES) / 10.0 + 0.4
    ahead = frames_at(walked(late))
    sharp = [
        acoustic_odometry.scale_evidence(
            ahead, claimed(1.0), CHIRP, replace(PARAMETERS, ahead_s=s)
        ).sharpness.mean(0)
        for s in (0.0, 0.2)
    ]
    assert sharp[1].max() > sharp[0].max(), "nearer to the moment that is heard"


@pytest.mark.parametrize("kind", ["noise", "silence", "the same all the time"])
def test_sound_that_tells_nothing_is_refused(kind: str) -> None:
    samples = np.zeros((FRAMES, ECHO_SAMPLES), np.float32)
    if kind == "noise":
        samples = np.random.default_rng(5).standard_normal(samples.shape).astype(np.float32)
    if kind == "the same all the time":
        samples += np.random.default_rng(6).standard_normal(ECHO_SAMPLES).astype(np.float32)
    t_s = np.arange(FRAMES) / 10.0
    mute = Echoes(t_s, samples, np.zeros((0, 2)))
    assert measure_scale(mute, claimed(1.0), CHIRP, PARAMETERS) == UNKNOWN


def test_the_error_is_half_as_much_again_as_windows_drawn_anew_scatter(echoes: Echoes) -> None:
    known = replace(PARAMETERS, model_sigma=0.0)
    scales, sharpness = acoustic_odometry.scale_evidence(echoes, claimed(1.1), CHIRP, known)
    generator, count = np.random.default_rng(3), len(sharpness)
    drawn = [sharpness[generator.integers(count, size=count)].mean(axis=0) for _ in range(400)]
    at = [np.polyfit(scales[k - 1 : k + 2], row[k - 1 : k + 2], 2) for row in drawn
          for k in [int(row.argmax())]]  # fmt: skip
    scatter = np.std([-b / (2 * a) for a, b, _ in at])
    found = measure_scale(echoes, claimed(1.1), CHIRP, known)
    assert found.sigma == pytest.approx(1.5 * scatter, rel=0.25)
    whole = measure_scale(echoes, claimed(1.1), CHIRP, replace(known, model_sigma=0.3))
    assert whole.sigma == pytest.approx(np.hypot(found.sigma, 0.3 * found.scale))


def test_standing_still_and_short_walks_are_refused(echoes: Echoes) -> None:
    still = acoustic_odometry.rescaled(claimed(1.0), ScaleEstimate(0.05, 0.01))
    assert measure_scale(echoes, still, CHIRP, PARAMETERS) == UNKNOWN
    few = replace(PARAMETERS, least_windows=6)
    assert measure_scale(echoes, claimed(1.0), CHIRP, few) == UNKNOWN
    none = Echoes(np.zeros(0), np.zeros((0, ECHO_SAMPLES), np.float32), np.zeros((0, 2)))
    assert measure_scale(none, claimed(1.0), CHIRP, PARAMETERS) == UNKNOWN


def test_a_scale_beyond_the_range_is_refused(echoes: Echoes) -> None:
    assert measure_scale(echoes, claimed(1.6), CHIRP, PARAMETERS) == UNKNOWN


def test_windows_that_disagree_are_refused(echoes: Echoes) -> None:
    walk = claimed(1.1)
    poses, half = walk.world_from_body.copy(), len(walk.t_s) // 2
    poses[half:, :2] = poses[half, :2] + 1.25 * (poses[half:, :2] - poses[half, :2])
    uneven = Odometry(walk.t_s, poses, walk.step_sigma)
    assert measure_scale(echoes, uneven, CHIRP, PARAMETERS) == UNKNOWN
    lenient = replace(PARAMETERS, most_scatter=1.0)
    assert measure_scale(echoes, uneven, CHIRP, lenient) != UNKNOWN


def test_a_picture_that_is_hardly_sharper_is_refused(echoes: Echoes) -> None:
    vague = replace(PARAMETERS, least_contrast=9.0)
    assert measure_scale(echoes, claimed(1.0), CHIRP, vague) == UNKNOWN


def test_loudness_has_no_mean_and_equal_spread_along_the_delays(echoes: Echoes) -> None:
    loud = acoustic_odometry.loudness(echoes.samples[:60], CHIRP)
    assert loud.shape[0] == 60
    assert np.abs(loud).max() <= 4.0
    assert np.abs(loud.mean(axis=0)).max() < 0.5
    assert np.sqrt((loud**2).mean()) == pytest.approx(1.0, abs=0.2)


def test_focus_is_the_fourth_power_of_what_piles_up() -> None:
    loud = np.zeros((3, 40), np.float32)
    for n, bin_ in enumerate((10, 13, 16)):
        loud[n, bin_] = 2.0
    earlier = np.array([[0.0, -3.0, -6.0], [0.0, 0.0, 0.0]])
    assert acoustic_odometry.focus(loud, earlier) == pytest.approx([6.0**4, 3 * 2.0**4])
    assert acoustic_odometry.focus(-loud, earlier) == pytest.approx([0.0, 0.0]), "dips are no walls"


def test_a_prior_holds_what_is_unknown_and_bows_to_what_is_certain() -> None:
    assert astuple(with_prior(UNKNOWN, 0.06)) == pytest.approx((1.0, 0.06))
    half = with_prior(ScaleEstimate(0.9, 0.06), 0.06)
    assert astuple(half) == pytest.approx((0.95, 0.06 / 2**0.5))
    assert with_prior(ScaleEstimate(0.9, 1e-4), 0.06).scale == pytest.approx(0.9, abs=1e-5)


def test_a_rescaled_walk_is_that_of_longer_steps() -> None:
    recording, _ = simulate(load_world("studio"), 100, rounds=1, sound=False)
    assert recording.imu is not None
    plain, start = MotionParameters(), (3.0, -2.0, 0.5)
    longer = replace(plain, step_scale=1.07)
    wanted = dead_reckon(recording.imu, longer, start)
    walked = dead_reckon(recording.imu, plain, start)
    made = acoustic_odometry.rescaled(walked, ScaleEstimate(1.07, 0.01))
    made_m, wanted_m = (each.world_from_body - each.world_from_body[0] for each in (made, wanted))
    assert made_m == pytest.approx(wanted_m, abs=1e-9)
    assert made.step_sigma == pytest.approx(wanted.step_sigma, abs=1e-9)


def test_a_simulated_walk_is_measured_to_two_percent() -> None:
    recording, truth = simulate(load_world("studio"), 105, rounds=3)
    nodes = dead_reckoning_nodes(recording, Parameters())
    heard = extract_echoes(recording, Parameters())
    found = measure_scale(heard, nodes, CHIRP, acoustic_odometry.AcousticOdometryParameters())
    inside = (truth.t_s >= nodes.t_s[0]) & (truth.t_s <= nodes.t_s[-1])
    lengths = [
        np.linalg.norm(np.diff(xy_m, axis=0), axis=1).sum()
        for xy_m in (truth.world_from_body[inside, :2][::25], nodes.world_from_body[:, :2])
    ]
    assert found.scale == pytest.approx(lengths[0] / lengths[1], rel=0.03)
    assert abs(found.scale - 1.0) > 1e-3
    assert found.sigma < 0.03
