"""Every value of the line declares its shapes, so that a mix-up stops where it happens."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from elfslam.base import values
from elfslam.base.arrays import Value
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, FixStatus

T_S = np.arange(3.0)
UNIT = np.eye(4)[:3]
MAKERS: dict[str, Callable[[], Value]] = {
    "Chirp": lambda: values.Chirp(np.zeros(441), 44_100, 0.1, [15e3, 20e3]),
    "Audio": lambda: values.Audio(np.zeros((2, 9)), 44_100),
    "Imu": lambda: values.Imu(T_S, np.zeros((3, 3)), np.zeros((3, 3))),
    "Magnetometer": lambda: values.Magnetometer(T_S, np.zeros((3, 3))),
    "Barometer": lambda: values.Barometer(T_S, np.full(3, 1013.0)),
    "Levels": lambda: values.Levels(T_S, [0.0, np.nan, 1.0], (None, None, None)),
    "WifiScans": lambda: values.WifiScans(
        T_S, ("a", "b"), np.full((3, 2), np.nan), np.zeros((3, 2))
    ),
    "Orientation": lambda: values.Orientation(T_S, UNIT),
    "Emr": lambda: values.Emr(T_S, np.zeros((3, 5))),
    "Checkpoints": lambda: values.Checkpoints(T_S, ("a", "b", "a"), np.zeros((3, 2))),
    "Odometry": lambda: values.Odometry(T_S, np.zeros((3, 3)), np.ones((2, 3))),
    "Truth": lambda: values.Truth(T_S, np.full((3, 3), np.nan)),
    "Echoes": lambda: values.Echoes(T_S, np.zeros((3, ECHO_SAMPLES)), np.zeros((0, 2))),
    "EchoPairs": lambda: values.EchoPairs(
        np.zeros((3, ECHO_SAMPLES)), np.zeros((3, ECHO_SAMPLES)), [0, 0, 1], np.zeros((3, 2))
    ),
    "Features": lambda: values.Features(T_S, UNIT, "stub"),
    "MeanSimilarity": lambda: values.MeanSimilarity(np.zeros((3, 2)), "stub"),
    "Similarity": lambda: values.Similarity(np.zeros((3, 3)), "stub"),
    "Closures": lambda: values.Closures([0], [2], [0.5], np.zeros((1, 3)), np.eye(3)[None, :, :]),
    "PoseGraph": lambda: values.PoseGraph(
        np.zeros((3, 3)),
        [[0, 1], [1, 2]],
        np.zeros((2, 3)),
        np.zeros((2, 3, 3)),
        [False, True],
        drift_turn_rad=np.zeros(2),
    ),
    "Trajectory": lambda: values.Trajectory(
        T_S, np.zeros((3, 3)), np.zeros((3, 3, 3)), np.zeros(1), "OK"
    ),
    "Payload": lambda: values.Payload("elf", "stub", np.zeros((3, 4))),
    "FloorMap": lambda: values.FloorMap(
        np.zeros((3, 2)), T_S, [0, 0, 0], [0, 1, 2], np.zeros((3, 2, 2)), (), "digest", ("walk",)
    ),
    "FrameFacts": lambda: values.FrameFacts(
        np.arange(3.0), np.zeros(3), *(np.ones(3) for _ in range(5))
    ),
    "Fixes": lambda: values.Fixes(
        T_S,
        np.full((3, 2), np.nan),
        np.full(3, np.nan),
        np.full((3, 2, 2), np.nan),
        np.full(3, np.nan),
        [FixStatus.OK, FixStatus.UNKNOWN_PLACE, FixStatus.NO_ECHO],
        np.array([0.0, np.nan, 1.0]),
    ),
}
NAN_ALLOWED = {
    "Checkpoints.xy_m",
    "Levels.level",
    "WifiScans.rssi_dbm",
    "WifiScans.age_s",
    "FrameFacts.late_s",
    "Truth.world_from_body",
    "Fixes.xy_m",
    "Fixes.heading_rad",
    "Fixes.covariance_m2",
    "Fixes.score",
    "Fixes.level",
}


def array_fields() -> list[tuple[str, str]]:
    """Every (type, field) that holds an array."""
    return [
        (name, field.name)
        for name in MAKERS
        for field in dataclasses.fields(getattr(values, name))
        if "array" in field.metadata
    ]


def test_every_value_is_tried_here() -> None:
    declared = {
        name
        for name, item in vars(values).items()
        if isinstance(item, type) and issubclass(item, Value) and item is not Value
    }
    assert declared == set(MAKERS)


@pytest.mark.parametrize(("name", "field"), array_fields())
def test_each_array_is_frozen_and_refused_with_another_shape(name: str, field: str) -> None:
    made = MAKERS[name]()
    given = getattr(made, field)
    assert not given.flags.writeable
    with pytest.raises(InputError, match=rf"{name}\.{field}: wanted shape .* got"):
        dataclasses.replace(made, **{field: np.zeros((*given.shape, 2))})


@pytest.mark.parametrize(("name", "field"), array_fields())
def test_nan_is_refused_but_where_it_means_unknown(name: str, field: str) -> None:
    made = MAKERS[name]()
    given = getattr(made, field)
    if given.dtype.kind != "f" or given.size == 0:
        assert (name, field) in {
            ("Echoes", "losses_s"),
            ("EchoPairs", "room"),
            ("Closures", "i"),
            ("Closures", "j"),
            ("PoseGraph", "edges"),
            ("PoseGraph", "is_closure"),
            ("FloorMap", "walk"),
            ("FloorMap", "changed"),
            ("FloorMap", "order"),
            ("Fixes", "status"),
        }
        return
    unknown = {field: np.full(given.shape, np.nan)}
    if f"{name}.{field}" in NAN_ALLOWED:
        assert np.isnan(getattr(dataclasses.replace(made, **unknown), field)).all()
    else:
        with pytest.raises(InputError, match=rf"{name}\.{field}: row 0 is not finite"):
            dataclasses.replace(made, **unknown)


@pytest.mark.parametrize("name", [name for name, field in array_fields() if field == "t_s"])
def test_time_runs_forward_in_every_value(name: str) -> None:
    with pytest.raises(InputError, match=rf"{name}\.t_s: time runs backward at row 1"):
        dataclasses.replace(MAKERS[name](), t_s=T_S[::-1])


def test_an_odometry_has_one_sigma_less_than_nodes() -> None:
    with pytest.raises(InputError, match=r"Odometry.step_sigma: wanted shape \(n-1, 3\)"):
        values.Odometry(T_S, np.zeros((3, 3)), np.ones((3, 3)))


def test_nodes_that_follow_each_other_keep_the_sigmas_between_them() -> None:
    sigma = np.arange(6.0).reshape(2, 3) + 1
    walk = values.Odometry(T_S, np.zeros((3, 3)), sigma, 0.1)
    for rows in (slice(1, None), np.array([False, True, True]), np.array([1, 2])):
        part = walk.chosen(rows)
        assert part.t_s.tolist() == [1, 2]
        assert part.step_sigma.tolist() == sigma[1:].tolist()
        assert part.scale_sigma == 0.1


def test_means_between_times_are_those_of_the_echoes_there() -> None:
    heard = values.Features(np.array([0.1, 0.2, 0.7]), UNIT, "stub")
    means = heard.means_between(np.array([0.0, 0.5, 1.0, 1.5]), fewest=1)
    np.testing.assert_allclose(means[:2], [UNIT[:2].mean(axis=0), UNIT[2]])
    assert np.isnan(means[2]).all()
    assert np.isnan(heard.means_between(np.array([0.0, 0.5, 1.0]), fewest=2)[1]).all()


def test_quaternions_and_features_must_be_unit_rows() -> None:
    with pytest.raises(InputError, match=r"Orientation.world_from_phone: wanted rows of length 1"):
        values.Orientation(T_S, 2 * UNIT)
    with pytest.raises(InputError, match=r"Features.vectors: wanted rows of length 1"):
        values.Features(T_S, np.zeros((3, 4)), "stub")


def test_an_echo_trace_is_exactly_one_image_of_48_windows() -> None:
    assert ECHO_SAMPLES == 96 + 47 * 48
    assert round((0.010 + 0.001) * 44_100) == values.DISCARDED_SAMPLES
    with pytest.raises(InputError, match=r"Echoes.samples: wanted shape \(n=3, 2352\)"):
        values.Echoes(T_S, np.zeros((3, 2205)), np.zeros((0, 2)))


def test_a_recording_holds_no_truth_and_nothing_by_default() -> None:
    names = [field.name for field in dataclasses.fields(values.Recording)]
    assert "truth" not in names
    bare = values.Recording("walk", "phone")
    assert not any(getattr(bare, name) for name in names[2:])


def test_a_map_of_which_nobody_says_its_age_is_new() -> None:
    made = dataclasses.replace(MAKERS["FloorMap"](), weight=None, changed=None)
    assert (made.weight == 1.0).all()
    assert not made.changed.any()
    with pytest.raises(InputError, match=r"FloorMap\.weight: wanted shape"):
        dataclasses.replace(made, weight=np.ones(len(made.weight) + 1))
