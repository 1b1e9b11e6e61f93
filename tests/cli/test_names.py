"""Names that are not ASCII, or no text at all, and terminals that cannot show them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from elfslam.base.text_files import readable
from elfslam.cli.app import run
from elfslam.data.map_files import read_facts

NAME = "Zoë 漢字"
LINES = """\
simulate studio {here}/walk2 --rounds 1
map {here}/walk {here}/run2 --by motion
show {here}/run {here}/page.html
score {here}/run {here}/walk
merge {here}/run {here}/again {here}/merged
card {here}/run/encoder.onnx
locate {here}/walk {here}/run {here}/fixes.csv
export {here}/run {here}/spots.parquet --to parquet
export {here}/run {here}/spots.geojson --to geojson --origin 47,8
export {here}/run {here}/walk.tum --to tum
export {here}/run {here}/walk.g2o --to g2o
export {here}/run {here}/é.yaml --to ros
export {here}/run {here}/used.onnx --to onnx
export {here}/nothing/é {here}/é.tum --to tum
"""
SCRIPT = """
import json, os, sys
from elfslam.cli import main
for line in json.load(sys.stdin):
    sys.argv = ["elfslam", *(os.fsdecode(each.encode()) for each in line)]
    try:
        main()
    except SystemExit as end:
        print(f"rc {end.code}", flush=True)
"""
ASCII = {"LC_ALL": "C", "LANG": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0",
         "PYTHONIOENCODING": "ascii"}  # fmt: skip


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk and its run in a folder whose name is not ASCII."""
    here = tmp_path_factory.mktemp("names") / NAME
    assert run(["simulate", "studio", str(here / "walk"), "--rounds", "1"]) == 0
    assert run(["map", str(here / "walk"), str(here / "run")]) in (0, 1)
    return here


@pytest.mark.hostile
def test_every_verb_takes_and_prints_names_without_utf_8(walked: Path, tmp_path: Path) -> None:
    here = tmp_path / NAME
    here.mkdir()
    for name in ("walk", "run"):
        (here / name).symlink_to(walked / name)
    (here / "again").symlink_to(walked / "run")
    lines = [[each.format(here=here) for each in line.split()] for line in LINES.splitlines()]
    ended = subprocess.run(
        [sys.executable, "-c", SCRIPT], input=json.dumps(lines).encode(), capture_output=True,
        env={**os.environ, **ASCII}, check=False,
    )  # fmt: skip
    said = ended.stderr.decode()
    assert "Traceback" not in said
    codes = [line for line in ended.stdout.decode().splitlines() if line.startswith("rc ")]
    assert codes == ["rc 0"] * 4 + codes[4:5] + ["rc 0"] * (len(lines) - 6) + ["rc 2"], said
    assert codes[4] in ("rc 0", "rc 1")
    assert json.loads((here / "é.yaml").read_text("utf-8").partition("\n")[0][7:]) == "é.pgm"


def test_a_name_that_is_no_text_is_escaped(walked: Path, tmp_path: Path) -> None:
    """Latin-1 in a world of UTF-8, as old zips bring it."""
    odd = tmp_path / os.fsdecode(b"caf\xe9")
    odd.symlink_to(walked / "walk")
    out = tmp_path / os.fsdecode(b"r\xfcn")
    assert run(["map", str(odd), str(out), "--by", "motion"]) == 0
    assert readable(odd.name) == r"caf\xe9"
    assert readable(os.fsdecode(b"\xc3\xab")) == readable("ë") == "ë"
    for name in (b"\xe9", b"\xfc"):
        (tmp_path / os.fsdecode(name)).symlink_to(walked / "run")
    runs = (str(tmp_path / os.fsdecode(name)) for name in (b"\xe9", b"\xfc"))
    assert run(["merge", *runs, str(tmp_path / "merged")]) in (0, 1)
    file = str(tmp_path / os.fsdecode(b"\xe9.parquet"))
    assert run(["export", str(out), file, "--to", "parquet"]) == 0
    assert run(["show", str(out), str(tmp_path / os.fsdecode(b"\xe9.html"))]) == 0
    assert os.listdir(os.fsencode(tmp_path)).count(b"\xe9.parquet") == 1


def test_control_characters_of_files_are_not_obeyed(
    walked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the name of a file, in a header, in a value, and in what a run says of itself."""
    evil = tmp_path / "\x1b]0;owned\x07\n[red]walk\u202e"
    evil.mkdir()
    (evil / "recording.json").write_text("{}")
    fixes = tmp_path / "fixes.csv"
    fixes.write_text("t_s,\x1b[2J\x9b,y\n")
    (tmp_path / "run").mkdir()
    for file in (walked / "run").iterdir():
        (tmp_path / "run" / file.name).write_bytes(file.read_bytes())
    told = {**read_facts(walked / "run"), "name": "\x1b[2Jrun", "heading": "\x1b[2J"}
    (tmp_path / "run" / "run.json").write_text(json.dumps(told))
    capsys.readouterr()
    for line in (
        ["map", evil, tmp_path / "out"],
        ["score", fixes, walked / "walk"],
        ["score", tmp_path / "run", walked / "walk"],
        ["show", tmp_path / "run", evil / "page.html"],
        ["import", "auto", evil, tmp_path / "in"],
        ["locate", evil, walked / "run", tmp_path / "out.csv"],
        ["parameters", "--set", "\x1b[2J"],
        ["\x1b[2J"],
    ):
        run(list(map(str, line)))
    seen = capsys.readouterr()
    assert {each for each in seen.out + seen.err if not each.isprintable()} <= {"\n"}
    assert "[red]walk" in seen.err
    assert r"\x1b[2Jrun" in seen.out
