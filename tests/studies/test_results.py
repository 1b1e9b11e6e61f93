"""Results as data: records become rows, rows are read again, and what is stale is found out."""

import dataclasses
from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from studies import results

MEDIAN = results.Record("ELF", "median error (m)", 0.25, world="office", scenario="surveyor")


def test_what_is_written_is_read(tmp_path: Path) -> None:
    records = [MEDIAN, dataclasses.replace(MEDIAN, value=1 / 3, low=0.3, high=0.4, paper=0.63)]
    made = list(results.stamped("mapping", records, "abcdef01", "2026-11-28"))
    results.write_results(tmp_path / "new.csv", made)
    again = results.read_results(tmp_path / "new.csv")
    assert [dataclasses.replace(each, value=0.0) for each in again] == [
        dataclasses.replace(each, value=0.0) for each in made
    ]
    assert [each.value for each in again] == pytest.approx([0.25, 1 / 3], rel=1e-5)
    assert again[0].commit == "abcdef01"
    assert again[0].low is None


def test_what_is_no_number_is_no_result() -> None:
    nothing = dataclasses.replace(MEDIAN, value=float("nan"))
    with pytest.raises(InputError, match="leave the row out"):
        list(results.stamped("mapping", [nothing], "a", "b"))


@pytest.mark.parametrize("text", ["", "study,value\nmapping,1\n", "\x00,"])
def test_a_file_of_another_form_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text + "no,thing\n")
    with pytest.raises(InputError, match=r"a\.csv: wanted columns study, commit"):
        results.read_results(tmp_path / "a.csv")
    with pytest.raises(InputError, match="missing"):
        results.read_results(tmp_path / "missing.csv")


def test_walks_are_averaged_by_what_they_are_of() -> None:
    other = dataclasses.replace(MEDIAN, method="plain spectrogram", value=2.0)
    nobody = dataclasses.replace(other, value=float("nan"))
    walks = [[MEDIAN, other], [dataclasses.replace(MEDIAN, value=0.75), nobody]]
    elf, plain = results.averaged(walks, (0, 1))
    assert (elf.method, elf.value, elf.seeds) == ("ELF", 0.5, "0 to 1")
    assert elf.low == 0.25
    assert elf.high == 0.75
    assert (plain.value, plain.low, plain.high) == (2.0, 2.0, 2.0)


def test_seeds_in_words() -> None:
    assert results.seeds_text((0, 1, 2)) == "0 to 2"
    assert results.seeds_text((100,)) == "100"
    assert results.seeds_text((0, 2)) == "0, 2"
