"""Kinds of figures: what each makes of a few planted results."""

from collections.abc import Iterator

import numpy as np
import pytest

from studies.drawing import KINDS, RETURNS, Drawing, _runs, _tiles
from studies.results import Record, Result, stamped


def planted(*records: Record) -> list[Result]:
    return list(stamped("planted", records, "12345678", "2026-01-01"))


def drawing(kind: str, **how: str) -> Drawing:
    return Drawing("planted", "planted", {}, kind, "caption", "x", **how)


@pytest.mark.parametrize("kind", ["points", "paths"])
def test_two_metrics_of_a_condition_are_a_point(kind: str) -> None:
    results = planted(
        *(Record("truth", metric, value, condition=str(k), world="mall")
          for k, xy in enumerate([(1.0, 2.0), (3.0, 5.0)])
          for metric, value in zip("xy", xy, strict=True))
    )  # fmt: skip
    [axis] = KINDS[kind](results, drawing(kind)).axes
    assert axis.lines[0].get_xydata().tolist() == [[1, 2], [3, 5]]


def test_traces_have_a_strip_each_and_returns_an_upright_in_all() -> None:
    def records() -> Iterator[Record]:
        for name in ("PSD", "ELF"):
            for k in range(4):
                yield Record(name, "ESS", 0.1 * k, condition=str(k))
        yield Record(RETURNS, "ESS", 1.0, condition="3")

    axes = KINDS["traces"](planted(*records()), drawing("traces")).axes
    assert [axis.get_title(loc="left") for axis in axes] == ["PSD", "ELF"]
    assert all(list(axis.lines[0].get_xdata()) == [3, 3] for axis in axes)


def test_a_matrix_is_over_both_numbers_or_over_one_and_the_rows() -> None:
    two = planted(*(Record("a", "dB", k, condition=f"{k} ms, 15.2 kHz") for k in (1, 2)))
    across, up, tiles = _tiles(two, "condition")
    assert (across, up, tiles.tolist()) == ([1, 2], [15.2], [[1, 2]])
    one = planted(*(Record(name, "ELF", 1.0, condition="7") for name in ("first", "second")))
    assert _tiles(one, "method")[:2] == ([7], ["second", "first"])
    assert _runs(np.array([[0, 2, 2, 1]])) == {(0, 1): (2, 2), (0, 3): (1, 1)}
    assert KINDS["matrix"](two, drawing("matrix", rows="condition")).axes
