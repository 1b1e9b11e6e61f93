"""Every command and what can be wrong with a path: one line, exit 2, nothing half-written."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from elfslam.cli import main

TINY = ("--set", "pretrain.steps=1", "--set", "pretrain.pairs=2", "--set", "pretrain.rooms=1")
READERS = {
    "map": "map {bad} {new}/run",
    "map by motion": "map {bad} {new}/run --by motion",
    "map with an encoder": "map {walk} {new}/run --encoder {bad}",
    "map on a plan": "map {walk} {new}/run --floor-plan {bad}",
    "map with parameters": "map {walk} {new}/run --parameters {bad}",
    "locate": "locate {bad} {run} {new}/fixes.csv",
    "locate in": "locate {walk} {bad} {new}/fixes.csv",
    "locate with an encoder": "locate {walk} {run} {new}/fixes.csv --encoder {bad}",
    "score": "score {bad} {walk}",
    "score against": "score {run} {bad}",
    "score on a plan": "score {run} {walk} --floor-plan {bad}",
    "score fixes": "score {bad}.csv {walk} --map {run} --map-truth {walk}",
    "score fixes in": "score {bad}.csv {walk} --map {bad} --map-truth {walk}",
    "show": "show {bad} {new}/page.html",
    "simulate": "simulate {bad} {new}/walk",
    "import mall": "import mall {bad} {new}/walks",
    "import magnetic": "import magnetic {bad} {new}/walk",
    "import sensorlogger": "import sensorlogger {bad} {new}/walk",
    "study": "study sensors {new}/study --data {bad}",
    "demo with parameters": "demo {new}/demo --parameters {bad}",
    "demo with an encoder": "demo {new}/demo --encoder {bad}",
    "pretrain": "pretrain {new}/one.onnx --parameters {bad}",
    "card": "card {bad}",
    "finetune": "finetune {bad} {new}/one.onnx",
    "finetune an encoder": "finetune {walk} {new}/one.onnx --encoder {bad}",
    "parameters": "parameters --parameters {bad}",
}
BAD = ("missing", "empty", "full", "text", "text/below", "damaged.zip", "damaged.npz")
WRITERS = {
    "map": "map {walk} {out} --by motion",
    "map by force": "map {walk} {out} --by motion --force",
    "simulate": "simulate studio {out} --rounds 1",
    "demo": "demo {out}",
    "locate": "locate {walk} {run} {out}",
    "show": "show studio {out}",
    "pretrain": "pretrain {out} " + " ".join(TINY),
    "pretrain a file": "pretrain {out}/one.onnx " + " ".join(TINY),
    "finetune a file": "finetune {walk} {out}/one.onnx --set finetune.shortest_s=1",
    "study": "study gait {out}",
}
INTO = {"demo": ("text", "text/below"), "show": ("full", "text/below")}
INTO |= {"locate": ("full", "text/below"), "study": ("text", "text/below")}
INTO |= {"pretrain a file": ("text", "text/below"), "finetune a file": ("text", "text/below")}
"""Not a folder with content where only one more file comes to lie in it, nor a file to replace."""


def run_command(line: str) -> int:
    """The exit code of `elfslam LINE` in this process."""
    before, sys.argv = sys.argv, ["elfslam", *line.split()]
    try:
        main()
    except SystemExit as leave:
        return int(leave.code or 0)
    finally:
        sys.argv = before
    raise AssertionError("the command must exit")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A walk and its run, by name."""
    folder = tmp_path_factory.mktemp("good")
    walk, run = folder / "walk", folder / "run"
    assert run_command(f"simulate studio {walk} --seed 112 --rounds 1") == 0
    assert run_command(f"map {walk} {run}") in (0, 1)
    return {"walk": walk, "run": run}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with everything that can lie where something else is wanted."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("mine")
    (tmp_path / "text").write_text("some words\n")
    (tmp_path / "damaged.zip").write_bytes(b"PK and no more")
    (tmp_path / "damaged.npz").write_bytes(b"PK and no more")
    before = contents(tmp_path)
    monkeypatch.setattr("elfslam.studies.catalogue.STUDIES", {"gait": lambda *_: [{"a": 1}]})
    yield tmp_path
    assert contents(tmp_path) == before


def contents(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def assert_refused(line: str, capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    code = run_command(line)
    seen = capsys.readouterr()
    assert (code, seen.out) == (2, "")
    assert len(seen.err.splitlines()) == 1
    assert seen.err.startswith("elfslam: ")
    return seen.err


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("command", READERS.values(), ids=READERS)
def test_a_wrong_path_to_read_is_refused_in_one_line(
    command: str,
    bad: str,
    good: dict[str, Path],
    place: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert_refused(command.format(bad=place / bad, new=place / "new", **good), capsys)


@pytest.mark.parametrize(
    ("command", "out"),
    [
        pytest.param(command, out, id=f"{name} into {out}")
        for name, command in WRITERS.items()
        for out in INTO.get(name, ("text", "text/below", "full"))
    ],
)
def test_a_place_that_cannot_be_written_is_refused_in_one_line(
    command: str,
    out: str,
    good: dict[str, Path],
    place: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert_refused(command.format(out=place / out, **good), capsys)


@pytest.mark.parametrize("alone", [False, True], ids=["run", "map.npz alone"])
def test_a_map_whose_encoder_is_gone_is_refused(
    alone: bool,
    good: dict[str, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "run").mkdir()
    shutil.copy(good["run"] / "map.npz", tmp_path / "run")
    floor_map = tmp_path / "run" / ("map.npz" if alone else "")
    line = f"locate {good['walk']} {floor_map} {tmp_path / 'fixes.csv'}"
    said = assert_refused(line, capsys)
    assert f"{tmp_path / 'run' / 'encoder.onnx'}: is missing" in said
    assert "--encoder" in said
    assert run_command(f"{line} --encoder compact") == 0


def test_a_map_without_learning_needs_no_encoder_beside_it(
    good: dict[str, Path], tmp_path: Path
) -> None:
    assert run_command(f"map {good['walk']} {tmp_path / 'run'} --encoder spectral") in (0, 1)
    line = f"locate {good['walk']} {tmp_path / 'run'} {tmp_path / 'fixes.csv'}"
    assert run_command(line) in (0, 1)
    assert (tmp_path / "fixes.csv").is_file()


def test_walks_left_out_of_a_score_are_listed(
    good: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("known", "secret"):
        shutil.copytree(good["run"], tmp_path / "runs" / name)
        (tmp_path / "walks" / name).mkdir(parents=True)
    shutil.copy(good["walk"] / "truth.tum", tmp_path / "walks" / "known")
    capsys.readouterr()
    assert run_command(f"score {tmp_path / 'runs'} {tmp_path / 'walks'} --json") == 0
    seen = capsys.readouterr()
    assert '"scored": 1' in seen.out
    assert seen.err.startswith("not scored: secret: ")
    (tmp_path / "walks" / "known" / "truth.tum").unlink()
    said = assert_refused(f"score {tmp_path / 'runs'} {tmp_path / 'walks'}", capsys)
    assert "none of 2 runs" in said


def test_a_folder_of_recordings_none_of_which_can_be_mapped_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("one", "two"):
        (tmp_path / "walks" / name).mkdir(parents=True)
        (tmp_path / "walks" / name / "recording.json").write_text("{}")
    said = assert_refused(f"map {tmp_path / 'walks'} {tmp_path / 'runs'}", capsys)
    assert "none of 2 could be mapped" in said
    assert "format_version" in said
    assert not (tmp_path / "runs").exists()
