"""Every value of the line declares its shapes, and names and claims of files are checked early."""

import dataclasses
import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base import values
from elfslam.base.arrays import Value
from elfslam.base.bounds import FREE_BYTES, MOST_BYTES, RATIO, check_claim, most_bytes
from elfslam.base.enums import Modality, parse_modalities
from elfslam.base.errors import LONGEST_CHARACTERS, ElfslamError, InputError, ParameterError
from elfslam.base.values import ECHO_SAMPLES, FixStatus

T_S = np.arange(3.0)
UNIT = np.eye(4)[:3]
XY_M, POSES, COVARIANCE = np.zeros((3, 2)), np.zeros((3, 3)), np.zeros((3, 3, 3))
ECHOES = np.zeros((3, ECHO_SAMPLES))
MAKERS: dict[str, Callable[[], Value]] = {
    "Chirp": lambda: values.Chirp(np.zeros(441), 44_100, 0.1, [15e3, 20e3]),
    "Audio": lambda: values.Audio(np.zeros((2, 9)), 44_100),
    "Imu": lambda: values.Imu(T_S, np.zeros((3, 3)), np.zeros((3, 3))),
    "Magnetometer": lambda: values.Magnetometer(T_S, np.zeros((3, 3))),
    "Barometer": lambda: values.Barometer(T_S, np.full(3, 1013.0)),
    "Levels": lambda: values.Levels(T_S, [0.0, np.nan, 1.0], (None, None, None)),
    "WifiScans": lambda: values.WifiScans(T_S, ("a", "b"), XY_M, XY_M),
    "Orientation": lambda: values.Orientation(T_S, UNIT),
    "Emr": lambda: values.Emr(T_S, np.zeros((3, 5))),
    "Checkpoints": lambda: values.Checkpoints(T_S, ("a", "b", "a"), np.zeros((3, 2))),
    "Odometry": lambda: values.Odometry(T_S, np.zeros((3, 3)), np.ones((2, 3))),
    "Truth": lambda: values.Truth(T_S, np.full((3, 3), np.nan)),
    "Echoes": lambda: values.Echoes(T_S, ECHOES, np.zeros((0, 2))),
    "EchoPairs": lambda: values.EchoPairs(ECHOES, ECHOES, [0, 0, 1], XY_M),
    "Features": lambda: values.Features(T_S, UNIT, "stub"),
    "MeanSimilarity": lambda: values.MeanSimilarity(np.zeros((3, 2)), "stub"),
    "Similarity": lambda: values.Similarity(np.zeros((3, 3)), "stub"),
    "Closures": lambda: values.Closures([0], [2], [0.5], np.zeros((1, 3)), np.eye(3)[None, :, :]),
    "PoseGraph": lambda: values.PoseGraph(
        POSES, [[0, 1], [1, 2]], POSES[1:], COVARIANCE[1:], [False, True], drift_turn_rad=T_S[1:]
    ),
    "Trajectory": lambda: values.Trajectory(T_S, POSES, COVARIANCE, np.zeros(1), "OK"),
    "Payload": lambda: values.Payload("elf", "stub", np.zeros((3, 4))),
    "FloorMap": lambda: values.FloorMap(
        XY_M, T_S, [0, 0, 0], [0, 1, 2], COVARIANCE[:, :2, :2], (), "digest", ("walk",)
    ),
    "FrameFacts": lambda: values.FrameFacts(T_S, T_S, *(np.ones(3) for _ in range(5))),
    "Fixes": lambda: values.Fixes(
        T_S, XY_M, T_S, COVARIANCE[:, :2, :2], T_S, [*FixStatus][:3], T_S
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


def test_senses_come_in_the_order_they_are_named() -> None:
    assert parse_modalities("wifi, elf") == (Modality.WIFI, Modality.ELF)
    assert parse_modalities(None) == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("smell", "wanted elf, wifi, magnetic, emr, motion, got 'smell'"),
        ("elf,elf", "name each modality once"),
        ("elf,motion", "motion closes no loops"),
        ("", "got ''"),
    ],
)
def test_senses_that_are_none_are_refused(text: str, words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        parse_modalities(text)


SIZES = st.integers(0, 2**40)


@given(SIZES, SIZES)
def test_more_bytes_may_claim_more_up_to_an_end(one: int, other: int) -> None:
    small, large = sorted((one, other))
    assert FREE_BYTES <= most_bytes(small) <= most_bytes(large) <= MOST_BYTES


@given(SIZES)
def test_the_most_may_be_claimed_and_no_byte_more(size: int) -> None:
    check_claim("walk", "its header", most_bytes(size), size)
    with pytest.raises(InputError, match="walk: its header claims"):
        check_claim("walk", "its header", most_bytes(size) + 1, size)


@pytest.mark.parametrize("claimed", [10.0**12, math.inf, math.nan, 10**30])
def test_what_no_machine_holds_is_refused(claimed: float) -> None:
    with pytest.raises(InputError, match="cut it in parts"):
        check_claim("walk", "its header", claimed, 10**9)


def test_a_file_may_hold_a_hundredfold() -> None:
    check_claim("walk", "it", FREE_BYTES + RATIO * 1000, 1000)


def test_a_sentence_comes_as_it_was_written() -> None:
    said = "map.npz: holds no poses, wanted some; map a walk first"
    assert str(InputError(said)) == said
    assert str(pickle.loads(pickle.dumps(InputError(said)))) == said


@pytest.mark.parametrize("quoted", ["9" * 5000, "x" * LONGEST_CHARACTERS])
def test_a_long_quotation_is_cut_in_its_middle(quoted: str) -> None:
    said = str(ElfslamError(f"world.toml: knows no {quoted}; remove it"))
    assert said.startswith("world.toml: knows no ")
    assert said.endswith("; remove it")
    assert len(said) < LONGEST_CHARACTERS
