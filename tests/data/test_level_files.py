"""Levels on disk: what was written is read, and what is no level is refused."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import LevelPassage, Levels
from elfslam.data.level_files import read_levels, write_levels

STAIRS = Levels(
    np.array([0.0, 30.5, 41.0]), np.array([0.0, np.nan, 1.0]), (None, LevelPassage.STAIRS, None)
)


def test_what_was_written_is_read(tmp_path: Path) -> None:
    write_levels(STAIRS, tmp_path / "levels.csv")
    read = read_levels(tmp_path / "levels.csv")
    assert np.array_equal(read.t_s, STAIRS.t_s)
    assert np.array_equal(read.level, STAIRS.level, equal_nan=True)
    assert read.passages == STAIRS.passages


def test_a_level_holds_until_the_next() -> None:
    at = STAIRS.at(np.array([-1.0, 30.0, 31.0, 41.0, 99.0]))
    assert np.array_equal(at, [0, 0, np.nan, 1, 1], equal_nan=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t_s,level\n0,0\n", "wanted the columns"),
        ("t_s,level,passage\n", "and a row"),
        ("", "wanted the columns"),
        ("t_s,level,passage\n0,ground,\n", "row 2 is '0,ground,"),
        ("t_s,level,passage\n0,0,\n1,,ladder\n", "row 3 is '1,,ladder"),
        ("t_s,level,passage\n0,0\n", "row 2 is '0,0"),
        ("t_s,level,passage\n1,0,\n0,1,\n", "time runs backward"),
    ],
)
def test_what_is_no_level_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "levels.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        read_levels(tmp_path / "levels.csv")
