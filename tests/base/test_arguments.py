"""Annotations hold at run time: what they allow goes through, all else is refused by name."""

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np
import pytest

from elfslam.base.arguments import Seed, Such, checked, fits, in_words
from elfslam.base.errors import ParameterError


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


@runtime_checkable
class Named(Protocol):
    @property
    def name(self) -> str: ...


@checked
def paint(where: Path | str, colour: Colour = Colour.RED, *, seed: Seed = 0, **more: Any) -> str:
    """Paints."""
    return f"{where} {colour} {seed} {more}"


def test_what_fits_goes_through_unchanged() -> None:
    assert paint("wall") == "wall red 0 {}"
    assert paint(Path("wall"), "blue", seed=7, thick=True) == "wall blue 7 {'thick': True}"


def test_the_function_stays_what_it_was() -> None:
    assert paint.__doc__ == "Paints."
    assert paint.__name__ == "paint"
    assert paint.__wrapped__.__annotations__ == paint.__annotations__


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (((3,), {}), "paint: where: wanted Path or text, got int 3; see help(paint)"),
        ((("wall", "green"), {}), "paint: colour: wanted red or blue, got str 'green'; see"),
        ((("wall",), {"seed": -1}), "paint: seed: wanted integer from 0 to 2**63 - 1, got int -1"),
        ((("wall",), {"seed": None}), "paint: seed: wanted integer from 0 to 2**63 - 1, got None"),
        (((), {}), "paint: missing a required argument: 'where'; see help(paint)"),
        ((("wall", Colour.RED, 3), {}), "paint: too many positional arguments; see help(paint)"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(
    given: tuple[tuple[Any, ...], dict[str, Any]], said: str
) -> None:
    with pytest.raises(ParameterError) as refused:
        paint(*given[0], **given[1])
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("wanted", "words", "good", "bad"),
    [
        (int, "integer", [0, np.int32(3)], [True, 1.0, "1", None]),
        (float, "finite number", [0, 1.5, np.float32(2)], [float("nan"), float("inf"), True, "1"]),
        (bool, "True or False", [True, np.bool_(0)], [0, 1, "True"]),
        (str, "text", ["", "a"], [b"a", None, 3]),
        (int | None, "integer or None", [None, 1], ["None"]),
        (tuple[float, str], "(finite number, text)", [(1, "a"), [1.0, "a"]], [(1,), (1, 2), "1a"]),
        (Sequence[int], "list of integer", [[], (1, 2)], ["12", {1}, 3, [1.5], np.zeros(2)]),
        (Mapping[str, Any], "dictionary", [{}, {"a": 1}], [{1: 1}, [("a", 1)]]),
        (Callable[[str], None], "function", [print, len], ["print", None]),
        (Path, "Path", [Path("a")], ["a", Path]),
        (Named, "Named", [Path("a")], ["a", Path, None]),
        (Colour, "red or blue", ["red", Colour.BLUE], ["green", 3]),
        (Annotated[int, Such(bool, "integer but 0")], "integer but 0", [1, -1], [0, "1", None]),
        (Any, "anything", [None, 1, Path], []),
    ],
    ids=str,
)
def test_annotations_by_kind(wanted: Any, words: str, good: list[Any], bad: list[Any]) -> None:
    assert in_words(wanted) == words
    assert all(fits(each, wanted) for each in good)
    assert not any(fits(each, wanted) for each in bad)


def test_a_long_value_is_shown_by_its_beginning_in_one_line() -> None:
    with pytest.raises(ParameterError) as refused:
        paint(np.zeros((50, 50)))
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 150
