"""Results as data: records become rows, rows are read again, and what is stale is found out."""

from __future__ import annotations

import dataclasses
import subprocess
from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from studies import results
from studies.results import (
    Record,
    averaged,
    changed_since,
    code_of,
    read_results,
    seeds_text,
    stamped,
    write_results,
)

MEDIAN = Record("ELF", "median error (m)", 0.25, world="office", scenario="surveyor")


def test_what_is_written_is_read(tmp_path: Path) -> None:
    records = [MEDIAN, dataclasses.replace(MEDIAN, value=1 / 3, low=0.3, high=0.4, paper=0.63)]
    made = list(stamped("mapping", records, "abcdef01", "2026-11-28"))
    write_results(tmp_path / "new.csv", made)
    again = read_results(tmp_path / "new.csv")
    assert [dataclasses.replace(each, value=0.0) for each in again] == [
        dataclasses.replace(each, value=0.0) for each in made
    ]
    assert [each.value for each in again] == pytest.approx([0.25, 1 / 3], rel=1e-5)
    assert again[0].commit == "abcdef01"
    assert again[0].low is None


def test_what_is_no_number_is_no_result() -> None:
    with pytest.raises(InputError, match="leave the row out"):
        list(stamped("mapping", [dataclasses.replace(MEDIAN, value=float("nan"))], "a", "b"))


@pytest.mark.parametrize("text", ["", "study,value\nmapping,1\n", "\x00,"])
def test_a_file_of_another_form_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text + "no,thing\n")
    with pytest.raises(InputError, match=r"a\.csv: wanted columns study, commit"):
        read_results(tmp_path / "a.csv")
    with pytest.raises(InputError, match="missing"):
        read_results(tmp_path / "missing.csv")


def test_walks_are_averaged_by_what_they_are_of() -> None:
    other = dataclasses.replace(MEDIAN, method="plain spectrogram", value=2.0)
    nobody = dataclasses.replace(other, value=float("nan"))
    walks = [[MEDIAN, other], [dataclasses.replace(MEDIAN, value=0.75), nobody]]
    elf, plain = averaged(walks, (0, 1))
    assert (elf.method, elf.value, elf.seeds) == ("ELF", 0.5, "0 to 1")
    assert elf.low == 0.25
    assert elf.high == 0.75
    assert (plain.value, plain.low, plain.high) == (2.0, 2.0, 2.0)


def test_seeds_in_words() -> None:
    assert seeds_text((0, 1, 2)) == "0 to 2"
    assert seeds_text((100,)) == "100"
    assert seeds_text((0, 2)) == "0, 2"


def test_the_code_of_a_module_is_what_it_imports_and_the_encoder() -> None:
    code = code_of("elfslam.world.simulate")
    assert {"src/elfslam/world/simulate.py", "src/elfslam/world/walker.py"} <= code
    assert "src/elfslam/weights/compact.onnx" in code
    assert not any(file.startswith(("src/elfslam/serve", "studies")) for file in code)


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project of one file, committed."""
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "gait.py").write_text('"""Gait."""\nSPEED = 1  # m/s\n')
    (tmp_path / "studies" / "other.py").write_text("")
    monkeypatch.setattr(results, "ROOT", tmp_path)
    monkeypatch.setattr(results, "code_of", lambda module: frozenset({"studies/gait.py"}))
    results.code_now.cache_clear()
    results._code_then.cache_clear()
    name = ("-c", "user.name=a", "-c", "user.email=a@b")
    for command in (("init", "-q"), ("add", "."), (*name, "commit", "-qm", "one")):
        subprocess.run(["git", "-C", str(tmp_path), *command], check=True)
    return tmp_path


def test_prose_makes_no_result_stale_and_code_does(project: Path) -> None:
    commit = results.git("rev-parse", "HEAD").strip()
    assert changed_since(commit, "gait") == []
    (project / "studies" / "gait.py").write_text(
        '"""How people walk."""\n\nfrom __future__ import annotations\n\nSPEED = 1\n'
    )
    (project / "studies" / "other.py").write_text("MORE = 1\n")
    assert changed_since(commit, "gait") == []
    results.code_now.cache_clear()
    (project / "studies" / "gait.py").write_text("SPEED = 2\n")
    assert changed_since(commit, "gait") == ["studies/gait.py"]


def test_of_an_unknown_commit_everything_has_changed(project: Path) -> None:
    assert changed_since("0" * 40, "gait") == ["studies/gait.py"]
