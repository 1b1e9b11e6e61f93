"""Every command that writes, on a disk that fills at every step, and on one that is read-only.

The work before the writing is done once: only the writing meets the disk.
"""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from whole_inputs import RESULTS

from elfslam.app import anchor as anchoring
from elfslam.app import anchor as plans
from elfslam.app import locate as locating
from elfslam.app import map as mapping
from elfslam.app import merge as joining
from elfslam.base.grid import resampled
from elfslam.base.values import FloorMap, Imu, Recording
from elfslam.cli import recordings as simulating
from elfslam.cli.app import run
from elfslam.data.map_files import write_map
from elfslam.data.recordings import write_recording
from elfslam.scoring.page import SCRIPT
from tests.disks import mounted

pytestmark = pytest.mark.hostile

PAGE = 4096
AMPLE = {"size": 256 * 2**20, "nr_inodes": 1000}
SIZES = 6
"""How many free sizes each command meets, from none to one page too few."""
TINY = " ".join(
    f"--set pretrain.{each}"
    for each in ("steps=2", "pairs=4", "rooms=2", "width=4", "component_batches=0")
)
QUICK = " ".join(
    f"--set finetune.{each}"
    for each in ("steps=4", "check_steps=2", "warmup_steps=1", "pairs=48", "shortest_s=20")
)
PLACE = "--origin 47,8 --place {given}/place.toml"
WRITERS = {
    "simulate": "simulate studio {disk}/new/out",
    "import": "import mall {given}/logs {disk}/out",
    "map": "map {given}/walk {disk}/new/out",
    "map many": "map {given}/walks {disk}/out --by motion",
    "merge": "merge {given}/one {given}/two {disk}/out",
    "locate": "locate {given}/walk {given}/one {disk}/out",
    "score": "score {disk}/run {given}/walk",
    "anchor": "anchor {given}/lap.npz {given}/plan.png:9.2 {disk}/out --start 1.6,1.6",
    "follow": "anchor {given}/one {given}/plan.png:30 {disk}/out --follow --start 15,15,0",
    "geojson": f"export {{given}}/one {{disk}}/out --to geojson {PLACE}",
    "imdf": f"export {{given}}/one {{disk}}/out --to imdf {PLACE}",
    "ros": "export {given}/one {disk}/out.yaml --to ros",
    "show a run": "show {given}/one {disk}/out",
    "pretrain": f"pretrain {{disk}}/out.onnx {TINY}",
    "finetune": "finetune {given}/walk {disk}/out.onnx " + QUICK,
    "card": "card --measured {given}/elf.csv --out {disk}/out.onnx",
}
"""What writes to the disk, by name."""
SEVERAL = {
    "pretrain": (SCRIPT, "out.checkpoint", "out.losses.csv", "out.losses.html"),
    "map many": ("out", "out/one"),
    "import": ("out", "out/one"),
}
"""What may stay where the rest does not fit: whole results, or what the next run goes on from."""
LONG = {
    "map": (mapping, "mapped_run"),
    "simulate": (simulating, "simulate_place"),
    "merge": (joining, "merge"),
    "locate": (locating, "locate"),
    "anchor": (plans, "place_on"),
    "follow": (anchoring, "follow"),
    "finetune": (mapping, "finetuned"),
}
"""Work before the writing, by the command that begins with it."""


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the commands read."""
    folder = tmp_path_factory.mktemp("given")
    for seed, name in enumerate(("walk", "walks/one", "walks/two")):
        assert run(f"simulate studio {folder}/{name} --seed {seed} --rounds 2".split()) == 0
    for name in ("one", "two"):
        assert run(f"map {folder}/walks/{name} {folder}/{name}".split()) == 0
    sensors = ("ACCELEROMETER", "GYROSCOPE")
    rows = [f"{k * 20}\tTYPE_{kind}\t0\t0\t9.8\t3" for k in range(99) for kind in sensors]
    (folder / "logs").mkdir()
    for name in ("one", "two"):
        (folder / "logs" / f"{name}.txt").write_text("\n".join(rows) + "\n")
    (folder / "marks.csv").write_text("name,x_m,y_m\nM1,1,2\nM2,9.5,2\n")
    told = {"name": "Hall", "category": "university", "address": "1 Way", "locality": "Zurich"}
    lines = [f'{name} = "{text}"' for name, text in (told | {"country": "CH"}).items()]
    (folder / "place.toml").write_text("\n".join([*lines, 'level = "Ground"', "ordinal = 0"]))
    pixels = np.zeros((80, 100), dtype=np.uint8)
    pixels[5:75, 5:95] = 255
    Image.fromarray(pixels).save(folder / "plan.png")
    write_map(lap(), folder / "lap.npz")
    (folder / "elf.csv").write_text(RESULTS)
    return folder


def lap() -> FloorMap:
    """One lap of 6 x 4 m."""
    corners = np.array([[0, 0], [6, 0], [6, 4], [0, 4], [0, 0]], dtype=np.float64)
    xy_m = resampled(corners, 0.2)
    count = len(xy_m)
    spread = np.tile(0.01 * np.eye(2), (count, 1, 1))
    order = np.arange(count)
    return FloorMap(xy_m, np.zeros(count), np.zeros(count), order, spread, (), "", ("lap",))


def remount(disk: Path, *options: str) -> None:
    subprocess.run(["mount", "-o", ",".join(["remount", *options]), str(disk)], check=True)


@pytest.fixture
def disk(given: Path, tmp_path: Path) -> Iterator[Path]:
    """A file system with older results on it; skips the test where none may be mounted."""
    with mounted(tmp_path / "disk", **AMPLE) as place:
        shutil.copytree(given / "one", place / "run")
        (place / "merged").mkdir()
        (place / "merged" / "merge.json").write_text("{}")
        (place / "fixes.csv").write_text("of an older walk\n")
        write_recording(still_and_moving(), place / "marked")
        yield place


def options(**limits: int) -> list[str]:
    return [f"{name}={value}" for name, value in limits.items()]


def still_and_moving() -> Recording:
    """Three pauses and two walks between them."""
    t_s = np.arange(3000) / 100
    moving = ((t_s > 4) & (t_s < 14)) | ((t_s > 17) & (t_s < 26))
    accel = np.column_stack([0 * t_s, 0 * t_s, 9.81 + 3 * moving * np.sin(12 * t_s)])
    return Recording("walk", "phone", imu=Imu(t_s, accel, 0 * accel))


@pytest.fixture
def once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Long work is done once in a test, whatever it is asked for."""
    for module, name in LONG.values():
        monkeypatch.setattr(module, name, remembered(getattr(module, name)))


def remembered(do: Callable[..., Any]) -> Callable[..., Any]:
    known: list[Any] = []

    def answer(*arguments: Any, **named: Any) -> Any:
        if not known:
            known.append(do(*arguments, **named))
        return known[0]

    return answer


def used(disk: Path) -> dict[str, int]:
    """Bytes and files that a disk holds."""
    told = os.statvfs(disk)
    size_bytes = (told.f_blocks - told.f_bfree) * told.f_frsize
    return {"size": size_bytes, "nr_inodes": told.f_files - told.f_ffree}


def most_used(disk: Path, do: Callable[[], object]) -> dict[str, int]:
    """What the disk held at most while results were made to last."""
    most, sync = used(disk), os.fsync

    def look(descriptor: int) -> None:
        for name, value in used(disk).items():
            most[name] = max(most[name], value)
        sync(descriptor)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", look)
        do()
    return most


def contents(folder: Path) -> dict[str, bytes | None]:
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def without(left: dict[str, bytes | None], names: tuple[str, ...]) -> dict[str, bytes | None]:
    """What is neither one of these nor lies in the last of them."""
    return {
        name: content
        for name, content in left.items()
        if name not in names and not (names and name.startswith(f"{names[-1]}/"))
    }


def emptied(disk: Path, before: dict[str, bytes | None]) -> None:
    """Take away what a run left and give back what it replaced."""
    for path in disk.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for name, content in before.items():
        if content is None:
            (disk / name).mkdir()
        else:
            (disk / name).write_bytes(content)


def assert_refused(line: str, disk: Path, why: str, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    code, said = run(line.split()), capsys.readouterr().err
    assert (code, said.count("\n")) == (2, 1), said
    assert said.startswith("elfslam: ")
    assert str(disk) in said
    assert why in said


@pytest.mark.usefixtures("once")
@pytest.mark.parametrize("limit", ["size", "nr_inodes"])
@pytest.mark.parametrize("name", WRITERS)
def test_a_disk_that_fills_at_any_step(
    name: str, limit: str, disk: Path, given: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit 2, older results untouched, and nothing half-written anywhere."""
    line, before = WRITERS[name].format(disk=disk, given=given), contents(disk)
    most = most_used(disk, lambda: run(line.split()))
    made = contents(disk)
    assert made != before
    emptied(disk, before)
    now = used(disk)[limit]
    needs = range(now, most[limit], PAGE if limit == "size" else 1)
    assert len(needs) > 0
    for value in {needs[k * (len(needs) - 1) // SIZES] for k in range(SIZES + 1)}:
        remount(disk, *options(**{**AMPLE, limit: value}))
        assert_refused(line, disk, "No space left on device", capsys)
        assert without(contents(disk), SEVERAL.get(name, ())) == before
        emptied(disk, before)
    remount(disk, *options(**AMPLE))
    assert run(line.split()) in (0, 1)
    assert contents(disk).keys() == made.keys()


@pytest.mark.usefixtures("once")
@pytest.mark.parametrize("name", WRITERS)
def test_a_read_only_disk(
    name: str, disk: Path, given: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Root, too, is told in one line."""
    line, before = WRITERS[name].format(disk=disk, given=given), contents(disk)
    remount(disk, "ro")
    assert_refused(line, disk, "Read-only file system", capsys)
    assert contents(disk) == before
