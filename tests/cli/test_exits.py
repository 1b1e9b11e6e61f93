"""Every command and what can be wrong with a path: one line, exit 2, nothing half-written."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from elfslam.base.extras import installing
from elfslam.cli.app import VERBS, run

Refused = Callable[[str], str]
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
    "demo with parameters": "demo {new}/demo --parameters {bad}",
    "demo with an encoder": "demo {new}/demo --encoder {bad}",
    "pretrain": "pretrain {new}/one.onnx --parameters {bad}",
    "card": "card {bad}",
    "finetune": "finetune {bad} {new}/one.onnx",
    "finetune an encoder": "finetune {walk} {new}/one.onnx --encoder {bad}",
    "parameters": "parameters --parameters {bad}",
}
BAD = ("missing", "full", "text", "text/below", "damaged.npz")
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
}
INTO = {"demo": ("text", "text/below"), "show": ("full", "text/below")}
INTO |= {"locate": ("full", "text/below")}
INTO |= {"pretrain a file": ("text", "text/below"), "finetune a file": ("text", "text/below")}
"""Not a folder with content where only one more file comes to lie in it, nor a file to replace."""


def run_command(line: str) -> int:
    """The exit code of `elfslam LINE` in this process."""
    return run(line.split())


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A walk and its run, by name."""
    folder = tmp_path_factory.mktemp("good")
    walk, run = folder / "walk", folder / "run"
    assert run_command(f"simulate studio {walk} --seed 112 --rounds 1 --kind quiet") == 0
    assert run_command(f"map {walk} {run}") in (0, 1)
    return {"walk": walk, "run": run}


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    """A folder with everything that can lie where something else is wanted."""
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("mine")
    (tmp_path / "text").write_text("some words\n")
    (tmp_path / "damaged.npz").write_bytes(b"PK and no more")
    before = contents(tmp_path)
    yield tmp_path
    assert contents(tmp_path) == before


def contents(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refused:
    """The one line by which a command is refused."""

    def said(line: str) -> str:
        capsys.readouterr()
        code = run_command(line)
        seen = capsys.readouterr()
        assert (code, seen.out) == (2, "")
        assert len(seen.err.splitlines()) == 1
        assert seen.err.startswith("elfslam: ")
        return seen.err

    return said


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("command", READERS.values(), ids=READERS)
def test_a_wrong_path_to_read_is_refused_in_one_line(
    command: str, bad: str, good: dict[str, Path], place: Path, refused: Refused
) -> None:
    refused(command.format(bad=place / bad, new=place / "new", **good))


@pytest.mark.parametrize(
    ("command", "out"),
    [
        pytest.param(command, out, id=f"{name} into {out}")
        for name, command in WRITERS.items()
        for out in INTO.get(name, ("text", "text/below", "full"))
    ],
)
def test_a_place_that_cannot_be_written_is_refused_in_one_line(
    command: str, out: str, good: dict[str, Path], place: Path, refused: Refused
) -> None:
    refused(command.format(out=place / out, **good))


@pytest.mark.parametrize("alone", [False, True], ids=["run", "map.npz alone"])
def test_a_map_whose_encoder_is_gone_is_refused(
    alone: bool, good: dict[str, Path], tmp_path: Path, refused: Refused
) -> None:
    (tmp_path / "run").mkdir()
    shutil.copy(good["run"] / "map.npz", tmp_path / "run")
    floor_map = tmp_path / "run" / ("map.npz" if alone else "")
    line = f"locate {good['walk']} {floor_map} {tmp_path / 'fixes.csv'}"
    said = refused(line)
    assert f"{tmp_path / 'run' / 'encoder.onnx'}: is missing" in said
    assert "--encoder" in said
    assert run_command(f"{line} --encoder compact") == 0


def test_maps_without_learning_need_no_encoder(good: dict[str, Path], tmp_path: Path) -> None:
    assert run_command(f"map {good['walk']} {tmp_path / 'run'} --encoder spectral") in (0, 1)
    line = f"locate {good['walk']} {tmp_path / 'run'} {tmp_path / 'fixes.csv'}"
    assert run_command(line) in (0, 1)
    assert (tmp_path / "fixes.csv").is_file()


def test_walks_left_out_of_a_score_are_listed(
    good: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Refused
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
    said = refused(f"score {tmp_path / 'runs'} {tmp_path / 'walks'}")
    assert "none of 2 runs" in said


def test_a_folder_of_recordings_none_of_which_can_be_mapped_is_refused(
    tmp_path: Path, refused: Refused
) -> None:
    for name in ("one", "two"):
        (tmp_path / "walks" / name).mkdir(parents=True)
        (tmp_path / "walks" / name / "recording.json").write_text("{}")
    said = refused(f"map {tmp_path / 'walks'} {tmp_path / 'runs'}")
    assert "none of 2 could be mapped" in said
    assert "format_version" in said
    assert not (tmp_path / "runs").exists()


WITHOUT_EXTRAS = {
    "parameters": None,
    "demo {new}/demo --set closure.threshold=2": None,
    "simulate studio {new}/simulated --rounds 1 --kind quiet --engine pyroomacoustics": "acoustics",
    "simulate studio {new}/simulated --rounds 1": None,
    "import sensorlogger {new}/simulated {new}/imported": None,
    "phyphox {new}/elfslam.phyphox": None,
    "marks {new}/simulated {new}/marks.csv A": None,
    "map {walk} {new}/run": None,
    "map {walk} {new}/tuned --finetune": "learn",
    "merge {run} {run} {new}/merged": None,
    "superimpose {run} {new}/floor": None,
    "locate {walk} {run} {new}/fixes.csv": None,
    "score {run} {walk}": None,
    "anchor {run} {new}/plan.png:3 {new}/anchored": "images",
    "way {run} 0:0,0 0:1,0": None,
    "export {run} {new}/run.parquet --to parquet": "parquet",
    "export {run} {new}/run.tum --to tum": None,
    "show {run} {new}/run.html": None,
    "pretrain {new}/one.onnx": "learn",
    "finetune {walk} {new}/one.onnx": "learn",
    "card": None,
    "card --measured {run}/run.json --out {new}/one.onnx": "learn",
    "serve --data {new}/data": "serve",
    "invite Zoë --data {new}/data": "serve",
    "publish {run} --building a --floor 0 --at 47,8 --data {new}/data": "serve",
    "withdraw --building a --floor 0 --data {new}/data": "serve",
    "buildings --data {new}/data": "serve",
}
"""Commands, and the extra that each asks for where none is installed."""
HIDE = """
import contextlib, io, json, sys
from importlib.machinery import PathFinder
find = PathFinder.find_spec
def find_others(name, *more):
    return None if name.split(".")[0] in HIDDEN else find(name, *more)
PathFinder.find_spec = find_others
from elfslam.cli.app import run
for line in json.load(sys.stdin):
    said, shown = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(shown):
        code = run(line.split())
    print(json.dumps([code, said.getvalue()]))
"""
HIDDEN = {
    *("alembic", "anyio", "cryptography", "faiss", "fastapi", "fsspec", "onnx", "PIL", "psycopg"),
    *("pyarrow", "pyroomacoustics", "pystoi", "ray", "s3fs", "segno", "sqlalchemy", "starlette"),
    *("torch", "trustme", "uvicorn"),
}


def test_without_extras_every_verb_works_or_names_the_one_it_needs(
    good: dict[str, Path], tmp_path: Path
) -> None:
    """In a process of its own, which has imported none of them."""
    lines = [line.format(new=tmp_path, **good) for line in WITHOUT_EXTRAS]
    assert {line.split()[0] for line in lines} == set(VERBS)
    ended = subprocess.run(
        [sys.executable, "-c", f"HIDDEN = {HIDDEN}{HIDE}"],
        input=json.dumps(lines), capture_output=True, text=True, check=True,
    )  # fmt: skip
    tried = zip(lines, ended.stdout.splitlines(), WITHOUT_EXTRAS.values(), strict=True)
    for line, told, extra in tried:
        code, said = json.loads(told)
        assert ("is not installed" in said) == (extra is not None), line
        if extra is not None:
            assert (code, said.count("\n")) == (2, 1), line
            assert installing(extra) in said, line
