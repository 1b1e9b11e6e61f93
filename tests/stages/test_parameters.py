"""Every parameter of the pipeline has two bounds, and between them nothing breaks."""

import dataclasses
import math
import re
import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elfslam.base.errors import InputError, NoAnswerError, ParameterError
from elfslam.base.parameters import load, replace, rows
from elfslam.base.values import Audio, Imu, Odometry, Recording, Similarity, Trajectory
from elfslam.slam import pipeline as slam
from elfslam.slam.parameters import Parameters
from elfslam.stages.closure import find_closures
from elfslam.stages.feature import SpectralEncoder
from elfslam.stages.graph import build_graph, optimise
from elfslam.world.simulate import load_world, simulate

PARAMETERS = Parameters()
SECONDS = 5.5


def numeric() -> dict[str, Any]:
    """What each number's field says of it, by the name group.field."""
    return {
        f"{group.name}.{item.name}": item.metadata
        for group in dataclasses.fields(PARAMETERS)
        for item in dataclasses.fields(getattr(PARAMETERS, group.name))
        if type(getattr(getattr(PARAMETERS, group.name), item.name)) in (int, float)
    }


NUMERIC = numeric()


@cache
def short_walk() -> Recording:
    """A few footsteps with their sound."""
    walk, _ = simulate(load_world("studio"), seed=3, rounds=1)
    kept = walk.imu.t_s <= SECONDS
    imu = Imu(walk.imu.t_s[kept], walk.imu.accel_mps2[kept], walk.imu.gyro_radps[kept])
    rate_hz = walk.audio.rate_hz
    audio = Audio(walk.audio.samples[:, : round(SECONDS * rate_hz)], rate_hz)
    return Recording("short", "simulated", audio=audio, imu=imu)


@cache
def two_rounds() -> tuple[Odometry, Similarity]:
    """Two rounds of a circle in 20 footsteps each, and what sounds alike on them."""
    turn_rad = 2 * np.pi / 20 * np.arange(41)
    poses = np.column_stack([2 * np.sin(turn_rad), 2 - 2 * np.cos(turn_rad), turn_rad])
    poses += 0.01 * np.random.default_rng(1).standard_normal(poses.shape)
    nodes = Odometry(0.5 * np.arange(41), poses, np.full((40, 3), 0.05))
    apart = np.abs(np.arange(40)[:, None] - np.arange(40))
    scores = np.exp(-((np.minimum(apart, np.abs(apart - 20)) / 2.0) ** 2))
    return nodes, Similarity(scores, "planted")


def close_loops(parameters: Parameters) -> Trajectory:
    nodes, similarity = two_rounds()
    closures = find_closures(similarity, nodes, parameters.closure)
    return optimise(build_graph(nodes, closures), nodes.t_s, parameters.graph)


def run_pipeline(parameters: Parameters) -> str:
    """How the pipeline ends: "mapped", or what the error says."""
    recording, encoder = short_walk(), SpectralEncoder()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            run = slam.map_by_echoes(recording, encoder, parameters)
            assert run.floor_map is not None
            slam.locate(recording, run.floor_map, encoder, parameters)
            close_loops(parameters)
        except (InputError, ParameterError, NoAnswerError) as error:
            return str(error)
    return "mapped"


def test_the_short_walk_is_mapped() -> None:
    assert run_pipeline(PARAMETERS) == "mapped"
    assert close_loops(PARAMETERS).status == "OK"


def test_every_number_has_both_bounds() -> None:
    open_ended = [n for n, item in NUMERIC.items() if None in (item["low"], item["high"])]
    assert open_ended == []
    assert len(NUMERIC) > 40


def test_a_value_outside_its_bounds_is_refused() -> None:
    for name, item in NUMERIC.items():
        low, high = item["low"], item["high"]
        below = low - 1 if type(low) is int else math.nextafter(low, -math.inf)
        above = high + 1 if type(low) is int else math.nextafter(high, math.inf)
        for value in (below, above):
            with pytest.raises(ParameterError, match=f"{name}: wanted a finite value from"):
                replace(PARAMETERS, name, value)


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(
    st.dictionaries(
        st.sampled_from(sorted(NUMERIC)), st.sampled_from(["low", "high"]), min_size=1, max_size=4
    )
)
def test_the_pipeline_runs_or_refuses_at_its_bounds(ends: dict[str, str]) -> None:
    changed = PARAMETERS
    for name, end in ends.items():
        changed = replace(changed, name, NUMERIC[name][end])
    ended = run_pipeline(changed)
    assert ended == "mapped" or (";" in ended and "\n" not in ended)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (["echo.slack_s=0.02", "echo.early_s=0.02", "chirp.period_s=0.08"], r"less than half of"),
        (["chirp.fade_s=0.006"], r"chirp.fade_s: wanted at most half of duration_s \(0.01 s\)"),
        (["chirp.band_low_hz=21000"], r"chirp.band_high_hz: wanted more than band_low_hz"),
        (["chirp.period_s=0.15"], r"chirps come every .* ms, not at the period"),
        (["chirp.period_s=0.2"], r"chirps come every 100.* ms, not at the period"),
        (["chirp.period_s=0.3"], r"chirps come every .* ms, not at the period"),
        (["motion.shortest_step_m=1.3"], r"motion.shortest_step_m: wanted at most longest_step_m"),
        (["locate.fewest_echoes=20"], r"locate.fewest_echoes: wanted no more than 0.6 s"),
    ],
)
def test_what_cannot_be_is_refused_with_a_reason(setting: list[str], message: str) -> None:
    try:
        said = run_pipeline(load(PARAMETERS, None, setting))
    except ParameterError as error:
        said = str(error)
    assert re.search(message, said)


def test_every_parameter_of_the_pipeline_has_a_meaning_and_stays_in_its_own_range() -> None:
    listed = list(rows(PARAMETERS))
    assert len(listed) > 40
    for row in listed:
        assert row.meaning
        text = f"'{row.value}'" if isinstance(row.value, str) else str(row.value).lower()
        assert load(PARAMETERS, None, [f"{row.name}={text}"]) == PARAMETERS
