"""Tables of numbers; damaged ones are refused in test_recordings."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from elfslam.base.errors import InputError
from elfslam.data import tables


@settings(max_examples=40, deadline=None)
@given(
    values=arrays(
        float, st.tuples(st.integers(1, 20), st.integers(1, 4)), elements=st.floats(-1e6, 1e6)
    )
)
def test_nine_digits_survive(tmp_path_factory: pytest.TempPathFactory, values: np.ndarray) -> None:
    file = tmp_path_factory.mktemp("table") / "a.csv"
    columns = ["a", "b", "c", "d"][: values.shape[1]]
    tables.write_timed_table(file, columns, np.arange(len(values)) / 50, values)
    assert tables.read_header(file) == ("t_s", *columns)
    t_s, read = tables.read_timed_table(file, columns)
    np.testing.assert_allclose(t_s, np.arange(len(values)) / 50)
    np.testing.assert_allclose(read, values, rtol=1e-8)


def test_a_byte_order_mark_and_spaces_do_no_harm(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbft_s, x \r\n0, 1e1 \r\n\r\n")
    assert tables.read_table(tmp_path / "a.csv", ["x", "t_s"]).tolist() == [[10, 0]]


def test_other_columns_may_hold_anything(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("note,x\nhello,1\n,2\n")
    assert tables.read_table(tmp_path / "a.csv", ["x"]).tolist() == [[1], [2]]


@pytest.mark.parametrize("end", tables.LINE_ENDS)
def test_more_lines_than_fit_are_refused(end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """However a line may end."""
    monkeypatch.setattr(tables, "MOST_LINES", 3)
    assert len(tables.lines_of(f"a{end}b{end}c", Path("log"))) == 3
    with pytest.raises(InputError, match="log: has more than 3 lines; cut it in parts"):
        tables.lines_of("a" + 4 * end, Path("log"))


def test_files_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"t_s,x\n\xff\xfe\x00")
    with pytest.raises(InputError, match=r"a\.csv: is no text in UTF-8"):
        tables.read_table(tmp_path / "a.csv", ["x"])
    with pytest.raises(InputError, match="cannot be read"):
        tables.read_table(tmp_path / "none.csv", ["x"])


@pytest.mark.parametrize(
    ("t_s", "kept"),
    [
        ([], []),
        ([1, 2, 2, 3], [1, 1, 1, 1]),
        ([1, 9, 2, 3], [1, 0, 1, 1]),
        ([1, 2, 0, 3], [1, 1, 0, 1]),
        ([1, 9, 2, 3, 0, 4], [1, 0, 1, 1, 0, 1]),
    ],
)
def test_only_what_is_out_of_order_is_left_out(t_s: list[float], kept: list[int]) -> None:
    assert tables.in_order(t_s).tolist() == kept


@given(st.lists(st.integers(0, 9), max_size=9))
def test_what_is_in_order_is_as_long_as_can_be(t_s: list[int]) -> None:
    kept = tables.in_order(t_s)
    assert (np.diff(np.array(t_s)[kept]) >= 0).all()
    sizes = range(len(t_s) + 1)
    subsets = itertools.chain(*(itertools.combinations(t_s, size) for size in sizes))
    assert kept.sum() == max(len(each) for each in subsets if list(each) == sorted(each))


def test_a_row_of_countless_characters_is_refused_before_it_is_read(tmp_path: Path) -> None:
    file = tmp_path / "walk.csv"
    file.write_text("t_s,x\n0,1\n1," + "2" * 200_000 + "\n")
    with pytest.raises(InputError, match="row 3 has 200002 characters, wanted at most 100000"):
        tables.read_table(file, ["t_s", "x"])
