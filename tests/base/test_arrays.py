"""Declared shapes are checked: what was wanted and what came stands in the refusal."""

from dataclasses import FrozenInstanceError, dataclass

import numpy as np
import pytest

from elfslam.base.arrays import F32, F64, I64, Value, array
from elfslam.base.errors import InputError


@dataclass(frozen=True, eq=False)
class Walk(Value):
    """One of each kind of field."""

    t_s: F64 = array("n", increasing=True)
    pose: F64 = array("n", 3)
    moves: F64 = array("n-1", 3)
    gain: F64 = array("m", finite=False)
    name: str
    facing: F32 | None = array("n", 2, dtype=np.float32, unit_rows=True, optional=True)
    count: I64 | None = array("m+1", dtype=np.int64, optional=True)
    spread: F64 | None = array("n", 2, 2, finite=False, covariance=True, optional=True)


def walk(**changes: object) -> Walk:
    """A walk of four poses that fits, but for the changes."""
    fields: dict[str, object] = {
        "t_s": np.arange(4.0),
        "pose": np.zeros((4, 3)),
        "moves": np.zeros((3, 3)),
        "gain": np.zeros(2),
        "name": "there and back",
    }
    return Walk(**(fields | changes))


def test_what_fits_is_kept() -> None:
    made = walk(facing=[[0, 1]] * 4, count=[1, 2, 3])
    assert made.t_s.tolist() == [0, 1, 2, 3]
    assert made.facing.dtype == np.float32
    assert made.count.dtype == np.int64


@pytest.mark.parametrize(
    ("field", "given", "wanted", "got"),
    [
        ("pose", np.zeros((4, 2)), "(n=4, 3)", "(4, 2)"),
        ("pose", np.zeros((5, 3)), "(n=4, 3)", "(5, 3)"),
        ("pose", np.zeros(4), "(n=4, 3)", "(4,)"),
        ("moves", np.zeros((4, 3)), "(n-1, 3)", "(4, 3)"),
        ("t_s", np.zeros((4, 1)), "(n)", "(4, 1)"),
        ("facing", np.ones((3, 2)), "(n=4, 2)", "(3, 2)"),
        ("count", np.ones(2), "(m+1)", "(2,)"),
        ("t_s", 3.0, "(n)", "()"),
    ],
)
def test_a_wrong_shape_names_type_field_wanted_and_got(
    field: str, given: object, wanted: str, got: str
) -> None:
    with pytest.raises(InputError) as refusal:
        walk(**{field: given})
    assert str(refusal.value) == f"Walk.{field}: wanted shape {wanted}, got {got}; check the array"


def test_the_first_field_sets_the_size_for_all_others() -> None:
    with pytest.raises(InputError, match=r"Walk.pose: wanted shape \(n=5, 3\), got \(4, 3\)"):
        walk(t_s=np.arange(5.0))


def test_one_row_has_no_moves_and_so_has_none() -> None:
    assert walk(t_s=[1.0], pose=np.zeros((1, 3)), moves=np.zeros((0, 3))).moves.shape == (0, 3)
    assert walk(t_s=[], pose=np.zeros((0, 3)), moves=np.zeros((0, 3))).pose.shape == (0, 3)
    with pytest.raises(InputError, match=r"Walk.moves"):
        walk(t_s=[1.0], pose=np.zeros((1, 3)), moves=np.zeros((1, 3)))


def test_an_offset_may_come_before_the_size_itself() -> None:
    @dataclass(frozen=True, eq=False)
    class Steps(Value):
        moves: F64 = array("n-1", 2)
        poses: F64 = array("n", 2)

    assert len(Steps(np.zeros((3, 2)), np.zeros((4, 2))).poses) == 4
    with pytest.raises(InputError, match=r"Steps.poses: wanted shape \(n=4, 2\), got \(2, 2\)"):
        Steps(np.zeros((3, 2)), np.zeros((2, 2)))


def test_arrays_are_read_only_copies() -> None:
    given = np.zeros((4, 3))
    made = walk(pose=given)
    given[0, 0] = 7.0
    assert made.pose[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        made.pose[0, 0] = 1.0
    with pytest.raises(FrozenInstanceError):
        made.pose = given


def test_a_size_one_longer_than_nothing_is_one() -> None:
    assert walk(gain=[], count=[5]).count.tolist() == [5]
    with pytest.raises(InputError, match=r"Walk.count: wanted shape \(m\+1\), got \(0,\)"):
        walk(gain=[], count=[])


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_the_first_row_that_is_not_finite_is_named(broken: float) -> None:
    pose = np.zeros((4, 3))
    pose[2, 1] = pose[3, 0] = broken
    with pytest.raises(InputError, match=r"Walk.pose: row 2 is not finite; remove or repair"):
        walk(pose=pose)


def test_nan_is_welcome_where_it_is_declared() -> None:
    assert np.isnan(walk(gain=[1.0, np.nan]).gain).tolist() == [False, True]


def test_time_that_repeats_or_runs_backward_is_named_with_its_row() -> None:
    with pytest.raises(InputError, match=r"time repeats at row 2 \(1.0000 then 1.0000 s\)"):
        walk(t_s=[0.0, 1.0, 1.0, 2.0])
    with pytest.raises(InputError, match=r"runs backward at row 3 \(2.0000 then 0.5000 s\)"):
        walk(t_s=[0.0, 1.0, 2.0, 0.5])


def test_rows_must_have_length_one_where_declared() -> None:
    good = np.tile([0.6, 0.8], (4, 1))
    assert walk(facing=good * 1.0005).facing is not None
    with pytest.raises(InputError, match=r"Walk.facing: wanted rows of length 1.*normalise"):
        walk(facing=good * [[1], [1], [1.01], [1]])


@pytest.mark.parametrize("field", ["t_s", "pose", "moves", "gain", "facing"])
@pytest.mark.parametrize("far", [1e300, -1e16])
def test_what_nobody_measures_is_named_before_it_is_squared(field: str, far: float) -> None:
    good = walk(facing=[[0, 1]] * 4)
    rows = np.array(getattr(good, field), dtype=np.float64)
    rows[-1] = far
    with pytest.raises(InputError, match=rf"Walk.{field}: (row \d is beyond 1e\+15|wanted)"):
        walk(**{field: rows})


@pytest.mark.parametrize(
    ("spread", "why"),
    [
        ([[1.0, 0.5], [0.4, 1.0]], "not symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], "not positive"),
        ([[-1.0, 0.0], [0.0, 1.0]], "not positive"),
        ([[1e-4, 0.0], [0.0, -1e-6]], "not positive"),
    ],
)
def test_what_is_no_covariance_is_named_with_its_row(spread: list[list[float]], why: str) -> None:
    nobody = np.full((2, 2), np.nan)
    given = np.array([nobody, np.eye(2), spread, np.eye(2)])
    with pytest.raises(InputError, match=rf"Walk.spread: row 2 is no covariance, as it is {why}"):
        walk(spread=given)


def test_a_covariance_may_be_of_less_than_full_rank_up_to_rounding() -> None:
    way = np.array([[0.3, 0.7], [1e-5, 3.0], [1e4, 1e-4], [0.0, 0.0]], dtype=np.float32)
    spread = (way[:, :, None] * way[:, None, :]).astype(np.float64)
    assert walk(spread=spread).spread is not None


def test_some_rows_are_chosen_of_what_has_as_many() -> None:
    @dataclass(frozen=True, eq=False)
    class Visits(Value):
        t_s: F64 = array("n")
        pose: F64 = array("n", 3)
        gain: F64 = array("m")
        name: str
        facing: F64 | None = array("n", optional=True)

    made = Visits(np.arange(4.0), np.arange(12.0).reshape(4, 3), np.zeros(5), "walk")
    some = made.chosen(np.array([False, True, False, True]))
    assert some.t_s.tolist() == [1, 3]
    assert some.pose[:, 0].tolist() == [3, 9]
    assert (len(some.gain), some.name, some.facing) == (5, "walk", None)
    assert made.chosen(slice(1, None)).t_s.tolist() == [1, 2, 3]


def test_optional_arrays_may_be_absent_and_others_may_not() -> None:
    assert walk().facing is None
    with pytest.raises(InputError, match=r"Walk.pose"):
        walk(pose=None)


def test_what_is_no_array_of_numbers_is_refused_with_what_came() -> None:
    with pytest.raises(InputError, match=r"Walk.pose: wanted numbers, got 'north'; pass an array"):
        walk(pose="north")
    with pytest.raises(InputError, match=r"Walk.pose: wanted numbers"):
        walk(pose=[[1.0, 2.0, 3.0], [1.0, 2.0]])


def test_a_dimension_that_is_neither_size_nor_name_is_the_authors_mistake() -> None:
    @dataclass(frozen=True, eq=False)
    class Odd(Value):
        rows: F64 = array("2n")

    with pytest.raises(ValueError, match="'2n' is neither a size nor a name"):
        Odd(np.zeros(2))


@pytest.mark.parametrize(
    ("field", "given"),
    [("count", [1, np.nan, 3]), ("count", [1, 1e300, 3]), ("facing", [[0, 1e300]] * 4)],
)
def test_numbers_that_the_array_cannot_hold_are_refused(field: str, given: object) -> None:
    with pytest.raises(InputError, match=rf"Walk\.{field}: wanted numbers"):
        walk(**{field: given})
