"""The line put together, on a simulated walk of two rounds through the studio."""

import dataclasses
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.testing as npt
import pytest
from scipy import signal

from elfslam.base import values
from elfslam.base.arrays import F64
from elfslam.base.enums import Mode
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, compose, shifted
from elfslam.base.parameters import digest
from elfslam.base.values import Checkpoints, FixStatus, Odometry, Recording, Run, Similarity, Truth
from elfslam.slam import pipeline as slam
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import Sense, map_by, map_by_echoes, no_similarity, optimise_walk
from elfslam.stages.checkpoints import CheckpointParameters, lies_on_plan, on_plan
from elfslam.stages.closure import ClosureParameters
from elfslam.stages.feature import Encoder, SpectralEncoder, load_encoder
from elfslam.world.circumstances import Circumstances
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world

PARAMETERS = Parameters()
AFTER_ECHOES = ["features", "similarity", "closures", "graph", "map"]


@pytest.fixture(scope="module")
def walk() -> tuple[Recording, Truth]:
    return simulate(load_world("studio"), seed=7, rounds=2)


@pytest.fixture(scope="module")
def recording(walk: tuple[Recording, Truth]) -> Recording:
    return walk[0]


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    return load_encoder("compact")


@pytest.fixture(scope="module")
def run(recording: Recording, encoder: Encoder) -> Run:
    return map_by_echoes(recording, encoder, PARAMETERS)


def noting(what_is_done: list[str]) -> Callable[[str, float], None]:
    return lambda what, share: what_is_done.append(what)


def true_xy_m(truth: Truth, t_s: F64) -> F64:
    columns = [np.interp(t_s, truth.t_s, truth.world_from_body[:, axis]) for axis in (0, 1)]
    return np.column_stack(columns)


def shape_error_m(xy_m: F64, wanted_m: F64) -> float:
    """How far distances between any two positions are off: no alignment is needed to compare."""
    apart, wanted = (np.linalg.norm(xy[:, None] - xy[None], axis=2) for xy in (xy_m, wanted_m))
    return float(np.sqrt(np.mean((apart - wanted) ** 2)))


def test_echoes_straighten_the_walk(run: Run, walk: tuple[Recording, Truth]) -> None:
    wanted_m = true_xy_m(walk[1], run.odometry.t_s)
    before_m = shape_error_m(run.odometry.world_from_body[:, :2], wanted_m)
    after_m = shape_error_m(run.trajectory.world_from_body[:, :2], wanted_m)
    assert run.trajectory.status == "OK"
    assert len(run.closures.i) >= 5
    assert after_m < 0.8 * before_m
    kept = run.trajectory.closure_weights > 0.5
    found = run.closures
    apart_m = np.linalg.norm(wanted_m[found.i[kept]] - wanted_m[found.j[kept]], axis=1)
    assert np.median(apart_m) < 0.5


def test_the_values_of_a_run_fit_together(run: Run, recording: Recording) -> None:
    nodes = len(run.odometry.t_s)
    npt.assert_array_equal(run.features.t_s, run.echoes.t_s)
    npt.assert_array_equal(run.trajectory.t_s, run.odometry.t_s)
    assert run.similarity.scores.shape == (nodes - 1, nodes - 1)
    assert len(run.trajectory.closure_weights) == len(run.closures.i)
    inside = (run.echoes.t_s >= run.odometry.t_s[0]) & (run.echoes.t_s <= run.odometry.t_s[-1])
    assert len(run.floor_map.xy_m) == inside.sum()
    assert run.floor_map.parameters_digest == digest(PARAMETERS)
    assert run.floor_map.sources == (recording.name,)
    assert run.floor_map.payloads[0].encoder == run.features.encoder
    assert run.name == recording.name
    assert len(run.echoes.t_s) > 9.5 * recording.audio.samples.shape[1] / recording.audio.rate_hz


def test_an_encoder_without_learning_runs_on_the_same_line(recording: Recording) -> None:
    announced: list[str] = []
    made = map_by_echoes(recording, SpectralEncoder(), PARAMETERS, announce=noting(announced))
    stages = ["motion", "echoes", "step length", *AFTER_ECHOES]
    assert announced == stages
    assert list(made.seconds) == stages
    assert all(0 < seconds < 60 for seconds in made.seconds.values())
    assert made.similarity.kind == "elf:spectral-1"
    neighbours = np.diagonal(made.similarity.scores, 1)
    assert neighbours.mean() > made.similarity.scores.mean() + 0.02


def test_a_footstep_sounds_like_itself_more_than_like_others(run: Run) -> None:
    scores = run.similarity.scores
    assert np.diagonal(scores)[5:-5].mean() > scores.mean() + 0.2


def test_fine_tuning_enters_as_a_function(recording: Recording) -> None:
    seen: list[tuple[Encoder, values.Echoes]] = []

    class Tuned(SpectralEncoder):
        identity = "tuned"

    def adapt(given: Encoder, echoes: values.Echoes) -> Encoder:
        seen.append((given, echoes))
        return Tuned()

    shipped = SpectralEncoder()
    made = map_by_echoes(recording, shipped, PARAMETERS, adapt=adapt)
    assert [given for given, _ in seen] == [shipped]
    assert seen[0][1] is made.echoes
    assert made.features.encoder == "tuned"


def test_one_recording_gives_one_run(recording: Recording, encoder: Encoder, run: Run) -> None:
    again = map_by_echoes(recording, encoder, PARAMETERS)
    npt.assert_array_equal(again.trajectory.world_from_body, run.trajectory.world_from_body)
    npt.assert_array_equal(again.closures.i, run.closures.i)


def test_whatever_makes_a_similarity_closes_loops(walk: tuple[Recording, Truth]) -> None:
    recording, truth = walk
    asked: list[tuple[Recording, Odometry]] = []

    def true_neighbours(given: Recording, nodes: Odometry) -> Similarity:
        asked.append((given, nodes))
        middle_s = np.array([(a + b) / 2 for a, b in pairwise(nodes.t_s)])
        xy_m = true_xy_m(truth, middle_s)
        apart_m = np.linalg.norm(xy_m[:, None] - xy_m[None, :], axis=2)
        return Similarity(np.exp(-((apart_m / 0.8) ** 2)).astype(np.float32), "oracle")

    announced: list[str] = []
    sense = Sense(true_neighbours, PARAMETERS.closure)
    made = map_by(recording, [sense], PARAMETERS, announce=noting(announced))
    stages = ["motion", "similarity", "closures", "graph"]
    assert announced == list(made.seconds) == stages
    assert asked[0][0] is recording
    assert asked[0][1] is made.odometry
    assert (made.floor_map, made.echoes, made.features) == (None, None, None)
    assert made.trajectory.status == "OK"
    wanted_m = true_xy_m(truth, made.odometry.t_s)
    before_m = shape_error_m(made.odometry.world_from_body[:, :2], wanted_m)
    assert shape_error_m(made.trajectory.world_from_body[:, :2], wanted_m) < 0.7 * before_m


def test_mapping_by_nothing_is_dead_reckoning(recording: Recording) -> None:
    made = map_by(recording, [Sense(no_similarity, PARAMETERS.closure)], PARAMETERS)
    assert made.trajectory.status == "NO_CLOSURES"
    assert made.similarity.scores.shape == (len(made.odometry.t_s) - 1,) * 2
    npt.assert_allclose(made.trajectory.world_from_body, made.odometry.world_from_body, atol=1e-6)


def test_places_named_by_hand_close_loops(walk: tuple[Recording, Truth]) -> None:
    recording, truth = walk
    plain = map_by(recording, [Sense(no_similarity, PARAMETERS.closure)], PARAMETERS)
    t_s = plain.odometry.t_s
    xy_m = true_xy_m(truth, t_s)
    again = int(len(t_s) // 2 + np.argmin(np.linalg.norm(xy_m[len(t_s) // 2 :] - xy_m[5], axis=1)))
    told = Checkpoints(t_s[[5, again]], ("Door", "Door"))
    named = dataclasses.replace(recording, checkpoints=told)
    run = map_by(named, [Sense(no_similarity, PARAMETERS.closure)], PARAMETERS)
    assert (run.closures.i.tolist(), run.closures.j.tolist()) == ([5], [again])
    tied = run.trajectory.world_from_body[[5, again], :2]
    loose = plain.trajectory.world_from_body[[5, again], :2]
    assert np.linalg.norm(np.diff(tied, axis=0)) < np.linalg.norm(np.diff(loose, axis=0))
    [door] = run.points_of_interest
    npt.assert_allclose((door.x_m, door.y_m), tied.mean(axis=0))
    assert door.name == "Door"
    assert plain.points_of_interest == ()


def test_places_named_by_hand_are_mapped(recording: Recording, encoder: Encoder, run: Run) -> None:
    told = Checkpoints(run.odometry.t_s[[5]], ("Door",))
    made = map_by_echoes(dataclasses.replace(recording, checkpoints=told), encoder, PARAMETERS)
    [door] = made.points_of_interest
    place = made.trajectory.world_from_body[5, :2]
    npt.assert_allclose((door.x_m, door.y_m), place)


def test_a_walk_is_located_in_its_own_map(recording: Recording, encoder: Encoder, run: Run) -> None:
    fixes = slam.locate(recording, run.floor_map, encoder, PARAMETERS)
    good = fixes.status == FixStatus.OK
    there = (fixes.t_s > run.odometry.t_s[0]) & (fixes.t_s < run.odometry.t_s[-1])
    assert (good & there).sum() > 0.95 * there.sum()
    t_s, poses = run.trajectory.t_s, run.trajectory.world_from_body
    columns = [np.interp(fixes.t_s, t_s, poses[:, axis]) for axis in (0, 1)]
    error_m = np.linalg.norm(fixes.xy_m - np.column_stack(columns), axis=1)[good & there]
    assert np.median(error_m) < 0.1


def test_another_walk_is_located_in_the_map(run: Run, encoder: Encoder) -> None:
    recording, truth = simulate(load_world("studio"), seed=8, rounds=1)
    fixes = slam.locate(recording, run.floor_map, encoder, PARAMETERS)
    good = fixes.status == FixStatus.OK
    assert good.mean() > 0.9
    wanted_m = true_xy_m(truth, fixes.t_s[good])
    assert shape_error_m(fixes.xy_m[good], wanted_m) < 0.25


def test_a_phone_that_hears_otherwise_is_heard_as_the_maps(
    recording: Recording, run: Run, encoder: Encoder
) -> None:
    """An encoder whose vectors are mirrored stands for a phone: its translation mirrors back."""
    size = run.floor_map.payloads[0].vectors.shape[1]
    mirror = np.diag(np.where(np.arange(size) % 2, -1.0, 1.0)).astype(np.float32)
    payload = run.floor_map.payloads[0]
    mirrored = dataclasses.replace(payload, vectors=payload.vectors @ mirror)
    other = dataclasses.replace(run.floor_map, payloads=(mirrored,))
    plain = slam.locate(recording, run.floor_map, encoder, PARAMETERS)
    lost = slam.locate(recording, other, encoder, PARAMETERS)
    found = slam.locate(recording, other, encoder, PARAMETERS, translation=mirror)
    npt.assert_array_equal(found.status, plain.status)
    npt.assert_allclose(found.xy_m, plain.xy_m, atol=1e-5)
    assert (lost.status == FixStatus.OK).mean() < 0.2


@pytest.mark.parametrize("mode", [Mode.TRAJECTORY, Mode.TRACK])
def test_footsteps_locate_another_walk_better(run: Run, encoder: Encoder, mode: Mode) -> None:
    recording, truth = simulate(load_world("studio"), seed=8, rounds=1)
    fixes = slam.locate(recording, run.floor_map, encoder, PARAMETERS, mode=mode)
    good = (fixes.status == FixStatus.OK) & (fixes.t_s <= truth.t_s[-1])
    assert good.mean() > 0.8
    assert shape_error_m(fixes.xy_m[good], true_xy_m(truth, fixes.t_s[good])) < 0.4
    again = slam.locate(recording, run.floor_map, encoder, PARAMETERS, mode=mode)
    npt.assert_array_equal(again.xy_m, fixes.xy_m)


def jammed(recording: Recording) -> tuple[Recording, float]:
    """A walk with noise in the chirp's band from some moment (s) on."""
    samples = recording.audio.samples.copy()
    first = samples.shape[1] // 2
    rough = np.random.default_rng(0).standard_normal(samples.shape[1] - first)
    band = signal.butter(4, [15_000, 20_000], "bandpass", fs=44_100, output="sos")
    samples[0, first:] += (0.05 * signal.sosfilt(band, rough)).astype(np.float32)
    return dataclasses.replace(recording, audio=values.Audio(samples, 44_100)), first / 44_100


@pytest.fixture(scope="module")
def scheduled() -> Recording:
    today = Circumstances(jitter_s=0.025)
    return simulate(load_world("studio"), seed=8, rounds=1, circumstances=today)[0]


@pytest.mark.parametrize("mode", Mode)
def test_the_untrusted_is_suspect(
    run: Run, encoder: Encoder, scheduled: Recording, mode: Mode
) -> None:
    recording, from_s = jammed(scheduled)
    fixes = slam.locate(recording, run.floor_map, encoder, PARAMETERS, mode=mode)
    told = fixes.status == FixStatus.SUSPECT
    assert not told[fixes.t_s < from_s].any()
    assert told[fixes.t_s > from_s + 2.0].mean() > 0.9
    if mode is not Mode.TRACK:
        assert np.isnan(fixes.xy_m[told]).all()


def test_no_schedule_is_no_judgement(run: Run, encoder: Encoder, recording: Recording) -> None:
    fixes = slam.locate(jammed(recording)[0], run.floor_map, encoder, PARAMETERS)
    assert FixStatus.SUSPECT not in fixes.status


def test_another_encoder_cannot_read_the_map(recording: Recording, run: Run) -> None:
    with pytest.raises(InputError, match="got echoes encoded by spectral-1"):
        slam.locate(recording, run.floor_map, SpectralEncoder(), PARAMETERS)


def test_the_line_needs_no_torch_and_no_plotting() -> None:
    program = (
        "import sys, elfslam.slam.pipeline; "
        "print([name for name in ('torch', 'plotly', 'fastapi') if name in sys.modules])"
    )
    asked = [sys.executable, "-c", program]
    done = subprocess.run(asked, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_later_sense_may_not_contradict_an_earlier_one() -> None:
    turn_rad = 2 * np.pi / 20 * np.arange(81)
    circle = np.column_stack([4 * np.sin(turn_rad), 4 - 4 * np.cos(turn_rad), turn_rad])
    nodes = Odometry(0.5 * np.arange(81), circle, np.full((80, 3), 0.2))
    sharp, shifted = ridges(80, 20), ridges(80, 17)
    known = ClosureParameters()
    alone = slam.closures_by(nodes, [(shifted, known)], PARAMETERS)
    together = slam.closures_by(nodes, [(sharp, known), (shifted, known)], PARAMETERS)
    first = slam.closures_by(nodes, [(sharp, known)], PARAMETERS)
    assert len(alone.i) > 20
    assert len(together.i) < len(first.i) + 0.2 * len(alone.i)
    npt.assert_array_equal(together.i[: len(first.i)], first.i)


def test_a_walk_once_corrected_leads_to_fainter_closures() -> None:
    turn_rad = 2 * np.pi / 20 * np.arange(81)
    circle = np.column_stack([4 * np.sin(turn_rad), 4 - 4 * np.cos(turn_rad), turn_rad])
    nodes = Odometry(0.5 * np.arange(81), circle, np.full((80, 3), 0.2))
    scores = ridges(80, 20).scores.copy()
    scores[60:], scores[:60, 60:] = 0.18 * scores[60:], 0.18 * scores[:60, 60:]
    fading, known = Similarity(scores, "planted"), ClosureParameters()
    unguided = dataclasses.replace(known, most_earned=0.0)
    first, both = (slam.closures_by(nodes, [(fading, by)], PARAMETERS) for by in (unguided, known))
    late = both.j > 66
    assert not (first.j > 66).any()
    assert late.any()
    npt.assert_allclose((both.j - both.i)[late] % 20, 0)


def test_closures_weigh_as_their_sense_shares_its_errors() -> None:
    nodes = Odometry(0.5 * np.arange(41), np.zeros((41, 3)), np.full((40, 3), 0.2))
    apart = dataclasses.replace(ClosureParameters(), shared_footsteps=0)
    shared = dataclasses.replace(apart, shared_footsteps=40)
    senses = ([(ridges(40, 20), known)] for known in (apart, shared))
    one, all_one = (slam.closures_by(nodes, given, PARAMETERS) for given in senses)
    npt.assert_allclose(all_one.covariance, len(one.i) * one.covariance)


def ridges(count: int, lap: int) -> Similarity:
    """Stretches alike where they are a multiple of `lap` apart."""
    away = np.abs(np.arange(count)[:, None] - np.arange(count)) % lap
    scores = np.exp(-((np.minimum(away, lap - away) / 1.5) ** 2))
    return Similarity(scores.astype(np.float32), "planted")


LAP, STEP_M = 40, 0.7
PLAN_FROM_WALK = np.array([31.0, -12.0, 2.1])
NOBODY = np.zeros(0, dtype=bool)
FAR_M = np.array([[1e3, 1e3], [5e5, 5e6]])


def square(bent_rad: float = 0.0) -> Odometry:
    """A lap round a square of 7 m by a gyroscope that reads too much, in half seconds."""
    turn = np.where(np.arange(LAP) % 10 == 9, np.pi / 2, 0.0) + bent_rad
    poses = [np.zeros(3)]
    for each in turn:
        poses.append(compose(poses[-1], np.array([STEP_M, 0.0, each])))
    sigma = np.tile(np.array([0.1, 0.05, 0.03]), (LAP, 1))
    return Odometry(np.arange(LAP + 1) / 2, np.array(poses), sigma)


TRUE = compose(PLAN_FROM_WALK, square().world_from_body)


def tapped(footsteps: list[int], off_m: F64 | None = None) -> Checkpoints:
    """Taps on the plan at some footsteps, and a place that was named only."""
    xy_m = TRUE[footsteps, :2] + (0.0 if off_m is None else off_m)
    names = (*(f"place {k}" for k in footsteps), "somewhere")
    t_s = np.array([*(k / 2 for k in footsteps), LAP / 2 + 0.25])
    return Checkpoints(t_s, names, np.vstack([xy_m, [np.nan, np.nan]]))


def straightened(nodes: Odometry, told: Checkpoints | None) -> values.Trajectory:
    return optimise_walk(nodes, values.NO_CLOSURES, NOBODY, told, PARAMETERS)[1]


def test_two_taps_give_the_walk_the_frame_of_the_plan() -> None:
    made = straightened(square(), tapped([3, 18]))
    npt.assert_allclose(made.world_from_body[:, :2], TRUE[:, :2], atol=0.02)
    npt.assert_allclose(np.cos(made.world_from_body[:, 2] - TRUE[:, 2]), 1, atol=1e-3)
    assert made.closure_weights.shape == (0,)
    assert len(made.t_s) == LAP + 1


def test_dead_reckoning_comes_along() -> None:
    bent = square(bent_rad=0.01)
    reckoned, made = optimise_walk(bent, values.NO_CLOSURES, NOBODY, tapped([0, 18]), PARAMETERS)
    moves = between(reckoned.world_from_body[:-1], reckoned.world_from_body[1:])
    expected = between(bent.world_from_body[:-1], bent.world_from_body[1:])
    npt.assert_allclose(moves, expected, atol=1e-9)
    npt.assert_allclose(reckoned.world_from_body[0, :2], made.world_from_body[0, :2], atol=1.0)


def test_its_uncertainty_is_that_of_the_taps() -> None:
    made = straightened(square(), tapped([3, 18]))
    sigma_m = np.sqrt(np.diagonal(made.covariance, axis1=1, axis2=2)[:, :2].max(axis=1))
    assert PARAMETERS.checkpoint.sigma_m / 2 < sigma_m[10] < 2 * PARAMETERS.checkpoint.sigma_m
    assert sigma_m[40] > sigma_m[10], "nothing was tapped after the eighteenth footstep"


def test_taps_straighten_a_bent_walk() -> None:
    bent = square(bent_rad=0.01)
    errors_m = [
        np.linalg.norm(straightened(bent, tapped(taps)).world_from_body - TRUE, axis=1)
        for taps in ([3, 18], [3, 13, 23, 33])
    ]
    assert errors_m[1].mean() < 0.5 * errors_m[0].mean()
    assert np.median(errors_m[1]) < PARAMETERS.checkpoint.sigma_m


@pytest.mark.parametrize(
    "told",
    [
        None,
        Checkpoints(np.array([1.5]), ("Door",)),
        tapped([3]),
        tapped([3, 4]),
        tapped([3, 18], np.array([[0.0, 0.0], [30.0, 0.0]])),
    ],
    ids=["none", "named", "one tap", "too near each other", "no walk is like that"],
)
def test_otherwise_the_walk_stays_in_the_frame_of_its_start(told: Checkpoints | None) -> None:
    nodes = square()
    made = straightened(nodes, told)
    npt.assert_allclose(made.world_from_body, nodes.world_from_body, atol=1e-9)
    assert not lies_on_plan(told, made, PARAMETERS.checkpoint)


@pytest.mark.parametrize("off_m", FAR_M, ids=["1 km", "UTM"])
def test_moving_the_plan_moves_the_walk_and_leaves_every_covariance(off_m: F64) -> None:
    told, bent = tapped([3, 13, 23, 33]), square(bent_rad=0.01)
    assert told.xy_m is not None
    here = straightened(bent, told)
    there = straightened(bent, replace(told, xy_m=told.xy_m + off_m))
    npt.assert_allclose(
        there.world_from_body - here.world_from_body,
        np.tile([*off_m, 0.0], (LAP + 1, 1)),
        atol=1e-6,
    )
    npt.assert_allclose(there.covariance, here.covariance, rtol=1e-5, atol=1e-9)
    assert there.status == here.status == "OK"


@pytest.mark.parametrize("off_m", FAR_M, ids=["1 km", "UTM"])
def test_moving_the_start_moves_the_walk_and_leaves_every_covariance(off_m: F64) -> None:
    """Of a walk that closes its loop by what it heard."""
    bent = square(bent_rad=0.01)
    covariance = np.diag([0.01, 0.01, 0.01])[None]
    home = values.Closures(
        np.array([0]), np.array([LAP]), np.ones(1), between(TRUE[:1], TRUE[LAP:]), covariance
    )  # fmt: skip
    believed = np.ones(1, dtype=bool)
    far = replace(bent, world_from_body=shifted(bent.world_from_body, off_m))
    here, there = (optimise_walk(at, home, believed, None, PARAMETERS)[1] for at in (bent, far))
    assert here.closure_weights.tolist() == [1.0]
    npt.assert_allclose(
        there.world_from_body - here.world_from_body,
        np.tile([*off_m, 0.0], (LAP + 1, 1)),
        atol=1e-6,
    )
    npt.assert_allclose(there.covariance, here.covariance, rtol=1e-5, atol=1e-9)


def test_a_wrong_tap_among_right_ones_is_not_believed() -> None:
    off_m = np.zeros((4, 2))
    off_m[2] = [8.0, -5.0]
    made = straightened(square(), tapped([3, 13, 23, 33], off_m))
    npt.assert_allclose(made.world_from_body[:, :2], TRUE[:, :2], atol=0.1)


def test_the_first_guess_is_the_best_rigid_fit() -> None:
    plan = on_plan(tapped([3, 13, 23]), square(), CheckpointParameters())
    npt.assert_allclose(plan.nodes.world_from_body[1:], TRUE, atol=1e-9)
    led_from, tapped_m = plan.nodes.world_from_body[0], TRUE[[3, 13, 23], :2]
    npt.assert_array_equal(led_from, [*np.median(tapped_m, axis=0), 0.0])
    npt.assert_allclose(compose(led_from, plan.closures.i_from_j)[:, :2], tapped_m)
    assert plan.closures.i.tolist() == [0, 0, 0]
    assert plan.closures.j.tolist() == [4, 14, 24]
