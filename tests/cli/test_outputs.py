"""Every verb that writes, and every place that is not to be written: one line, and all is kept."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from elfslam.cli.app import VERBS, command_of, run

Said = Callable[..., str]
FILES = {
    "locate": "locate {walk} {run} {out} --phone-walk {other} --parameters {toml} --encoder {onnx}",
    "export tum": "export {npz} {out} --to tum",
    "export g2o": "export {run} {out} --to g2o",
    "export onnx": "export {run} {out} --to onnx",
    "export geojson": "export {run} {out} --to geojson --origin 47,8",
    "export imdf": "export {run} {out} --to imdf --origin 47,8 --place {venue}",
    "export ros": "export {run} {out} --to ros",
    "export parquet": "export {run} {out} --to parquet",
    "show": "show {npz} {out}",
    "phyphox": "phyphox {out} --parameters {toml}",
    "pretrain": "pretrain {out} --parameters {toml}",
    "finetune": "finetune {walk} {out} --encoder {onnx} --parameters {toml}",
    "card": "card {onnx} --measured {json} --out {out}",
}
"""Verbs that write a file; OUT comes to be the place that is to be refused."""
FOLDERS = {
    "demo": "demo {out} --parameters {toml}",
    "simulate": "simulate {toml} {out}",
    "import": "import phyphox {log} {out}",
    "map": "map {walk} {out} --encoder {onnx} --parameters {toml}",
    "merge": "merge {run} {other} {out} --parameters {toml}",
    "superimpose": "superimpose {run} {out} --parameters {toml}",
    "anchor": "anchor {run} {plan}:10 {out} --parameters {toml}",
}
READ_ONLY = {
    "marks": "a recording without truth gets its own",
    "score": "a run gets its own page",
    "parameters": "prints",
    "way": "prints",
    "serve": "its data folder is its own",
    "invite": "as serve",
    "publish": "as serve",
    "withdraw": "as serve",
    "buildings": "as serve",
}
"""Verbs without a place for a result, and why they need none."""
ENDINGS = {"pretrain": ".onnx", "finetune": ".onnx", "export ros": ".yaml"}
INPUTS = {
    "walk": "walk.zip",
    "other": "other.zip",
    "run": "run",
    "npz": "lap/lap.npz",
    "onnx": "used.onnx",
    "toml": "some.toml",
    "venue": "venue.toml",
    "json": "elf.json",
    "log": "log.zip",
    "plan": "plan.png",
}
VENUE = """
name = "Museum"
category = "museum"
address = "1"
locality = "Bern"
country = "CH"
level = "0"
ordinal = 0
"""
OWNED = ("run/run.json", "recording/recording.json", "merged/merge.json", "anchored/anchor.json")
NOWHERE = ("", "{here}/..")
"""Every way to say so is in tests/data/test_atomic_files.py."""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A place full of other people's files, in which one stands."""
    for name in (*INPUTS.values(), *OWNED, "here/notes.txt", "server/store.json"):
        file = tmp_path / name
        if file.suffix:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(f"precious {name}")
            for ending in set(ENDINGS.values()):
                file.with_suffix(ending).exists() or file.with_suffix(ending).write_text("mine")
    (tmp_path / "some.toml").write_text("")
    Image.new("L", (40, 40), 255).save(tmp_path / "plan.png")
    (tmp_path / "venue.toml").write_text(VENUE)
    (tmp_path / "server" / "blobs").mkdir()
    (tmp_path / "server" / "blobs" / "one.yaml").write_text("precious")
    (tmp_path / "server" / "blobs" / "one.onnx").write_text("precious")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path


def contents(folder: Path) -> dict[Path, bytes | None]:
    """Every name in a folder with the bytes behind it."""
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture
def said_of(place: Path, capsys: pytest.CaptureFixture[str]) -> Said:
    """The one line by which a command is refused that is to write to `out`; all is kept."""
    given = {name: place / file for name, file in INPUTS.items()}

    def said(line: str, out: object, *more: str) -> str:
        before = contents(place)
        capsys.readouterr()
        code = run([*(part.format(out=out, **given) for part in line.split()), *more])
        seen = capsys.readouterr()
        assert (code, seen.out) == (2, ""), seen.err
        assert len(seen.err.splitlines()) == 1
        assert contents(place) == before
        return seen.err

    return said


def has_force(line: str) -> bool:
    return any(each.name == "force" for each in command_of(line.partition(" ")[0]).params)


def test_every_verb_that_writes_is_tried_here() -> None:
    writing = {verb for verb in VERBS if any(at.name == "out" for at in command_of(verb).params)}
    assert {line.split()[0] for line in (*FILES.values(), *FOLDERS.values())} == writing
    assert writing | set(READ_ONLY) == set(VERBS)
    assert not writing & set(READ_ONLY)
    assert all(map(has_force, FILES.values()))


@pytest.mark.parametrize("name", [*FILES, *FOLDERS])
@pytest.mark.parametrize("out", NOWHERE)
def test_no_result_goes_into_the_current_folder_or_above(
    name: str, out: str, place: Path, said_of: Said
) -> None:
    said = said_of((FILES | FOLDERS)[name], out.format(here=place / "here"))
    assert "is the current folder or one above it; name a new place" in said


@pytest.mark.parametrize("name", FILES)
def test_older_files_are_kept(name: str, place: Path, said_of: Said) -> None:
    """It is said before anything is read: none of the inputs is what it is called."""
    old = (place / "here" / "notes.txt").with_suffix(ENDINGS.get(name, ".txt"))
    for out in (old, os.path.relpath(old)):
        said = said_of(FILES[name], out)
        assert "already exists" in said
        assert "or replace an older result with --force" in said


@pytest.mark.parametrize("name", FILES)
def test_force_never_replaces_what_belongs_to_others(name: str, place: Path, said_of: Said) -> None:
    """Neither by its own name nor by a link: files of recordings, runs, maps and servers."""
    ending = ENDINGS.get(name, ".json")
    files = [(place / owned).with_suffix(ending) for owned in OWNED]
    if ending != ".json":
        files.append(place / "server" / "blobs" / f"one{ending}")
    for count, file in enumerate(files):
        link = place / f"{count}{ending}"
        link.symlink_to(file)
        for out in (file, link):
            said = said_of(FILES[name], out, "--force")
            assert "belongs to" in said or "is read from there" in said


@pytest.mark.parametrize("name", FILES)
def test_force_spares_inputs(name: str, place: Path, said_of: Said) -> None:
    ending = ENDINGS.get(name, "")
    for what, file in INPUTS.items():
        if f"{{{what}}}" not in FILES[name] or not (place / file).is_file():
            continue
        soft, hard = place / f"soft-{what}{ending}", place / f"hard-{what}{ending}"
        soft.symlink_to(place / file)
        hard.hardlink_to(place / file)
        for out in (soft, hard, *([place / file] if file.endswith(ending) else [])):
            assert "is read from there" in said_of(FILES[name], out, "--force")


@pytest.mark.parametrize("name", FILES)
def test_folders_stay_folders(name: str, place: Path, said_of: Said) -> None:
    folder = place / f"folder{ENDINGS.get(name, '')}"
    folder.mkdir()
    assert "is no file" in said_of(FILES[name], folder, "--force")


@pytest.mark.parametrize("name", ["export ros", "pretrain"])
def test_files_that_come_beside_are_kept_too(name: str, place: Path, said_of: Said) -> None:
    beside = place / ("new.pgm" if name == "export ros" else "new.losses.html")
    beside.write_text("mine")
    said = said_of(FILES[name], place / f"new{ENDINGS[name]}")
    assert f"{beside}: already exists" in said


@pytest.mark.parametrize("name", FOLDERS)
def test_alien_folders_are_kept(name: str, place: Path, said_of: Said) -> None:
    """Without force whatever it is, with force all but an older result of the same kind."""
    line, out = FOLDERS[name], place / "lap"
    if name == "demo":
        shutil.copytree(place / "lap", place / "demo" / "run")
        out = place / "demo"
    for more in [(), ("--force",)] if has_force(line) else [()]:
        said = said_of(line, out, *more)
        assert ("so it is kept" in said) if more else ("already exists" in said)


@pytest.mark.parametrize("name", ["map", "merge", "superimpose"])
def test_an_older_result_that_holds_what_is_read_is_kept(
    name: str, place: Path, said_of: Said
) -> None:
    holder = place / ("run" if name == "map" else "merged")
    (holder / "inputs").mkdir()
    shutil.copy(place / "some.toml", holder / "inputs")
    line = FOLDERS[name].replace("{toml}", str(holder / "inputs" / "some.toml"))
    assert "is read from there" in said_of(line, holder, "--force")


def test_force_replaces_a_file(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = place / "here" / "elfslam.phyphox"
    assert run(["phyphox", str(out)]) == 0
    first = out.read_bytes()
    out.write_text("older")
    assert run(["phyphox", str(out), "--force"]) == 0
    assert out.read_bytes() == first
