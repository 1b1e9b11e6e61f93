"""What once ended a command in a traceback, took all memory or passed for good: refused now."""

import io
import json
import lzma
import struct
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cases import Target, copied, run
from damaged_formats import changed_lzma, zip_directory
from foreign_encoders import ALLOCATES, FAILS, GROWS, LOOPS, OTHERS, foreign_encoder
from forked_commands import Commands

pytestmark = pytest.mark.hostile
Attack = Callable[[Path], None]


ABOUT = b'{"format_version": 1}' * 99


def content(given: bytes) -> Attack:
    return lambda file: _write(file, given)


def text(told: str) -> Attack:
    return content(told.encode())


def encoder(nodes: tuple[object, ...]) -> Attack:
    return lambda file: _write(file, foreign_encoder(*nodes))  # type: ignore[arg-type]


def corners(given: object) -> Attack:
    return text(json.dumps({"type": "Polygon", "coordinates": given}))


def _write(file: Path, content: bytes) -> None:
    file.unlink()
    file.write_bytes(content)


def arrays(file_name: str, **others: object) -> Attack:
    def attack(folder: Path) -> None:
        file = folder / file_name
        with np.load(file) as stored:
            made = {**stored, **others}
        file.unlink()
        np.savez(file, **made)

    return attack


def a_claim_of_numbers(folder: Path) -> None:
    head = "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }".ljust(117) + "\n"
    told = b"\x93NUMPY\x01\x00" + struct.pack("<H", 118) + head.encode()
    (folder / "map.npz").unlink()
    with zipfile.ZipFile(folder / "map.npz", "w") as archive:
        archive.writestr("xy_m.npy", told)


def a_claim_of_samples(folder: Path) -> None:
    flac = (folder / "audio.flac").read_bytes()
    _write(folder / "audio.flac", flac[:22] + struct.pack(">I", 2_000_000_000) + flac[26:])


def a_zip_of(size: int, count: int) -> Attack:
    def attack(file: Path) -> None:
        file.unlink()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for k in range(count):
                archive.writestr(f"{k}.csv", bytes(size))

    return attack


def an_archive_of(kind: bytes) -> Attack:
    def attack(file: Path) -> None:
        info = tarfile.TarInfo("walk.txt")
        info.type = kind
        _write(file, lzma.compress(info.tobuf() + bytes(1024)))

    return attack


def an_archive_without_walks(file: Path) -> None:
    made = io.BytesIO()
    with tarfile.open(fileobj=made, mode="w:xz") as archive:
        archive.addfile(tarfile.TarInfo("notes.json"))
    _write(file, made.getvalue())


def a_ring(count: int) -> list[list[list[float]]]:
    turn = np.linspace(0, 2 * np.pi, count)
    wide = 1e-3 * (1 + 0.3 * np.sin(1001 * turn))
    return [np.column_stack([8.5 + wide * np.cos(turn), 47 + wide * np.sin(turn)]).tolist()]


MAP, MAP_BY_MOTION = "map {given} {out}", "map {base}/quiet {out} --by motion"
PLAN = "anchor {base}/run {given} {out}"
SHOW, LOCATE = "show {given} {out}", "locate {base}/walk {given} {out}"
SETTINGS = MAP_BY_MOTION + " --parameters {given}"
WITH_ENCODER = "map {base}/walk {out} --encoder {given} --until 15"
MALL = "import mall {given} {out}"
ATTACKS: dict[str, tuple[str, str, Attack]] = {
    "a zip packed by LZMA, changed": (
        "walk.zip",
        MAP,
        content(changed_lzma("recording.json", ABOUT)),
    ),
    "a zip that unpacks to 600 MB": ("walk.zip", MAP, a_zip_of(30_000_000, 20)),
    "a zip of 1.5 million entries": ("walk.zip", MAP, content(zip_directory(1_500_000))),
    "a zip of 2,000 files": ("walk.zip", MAP, a_zip_of(0, 2000)),
    "an array of 10^12 numbers": ("run", SHOW, a_claim_of_numbers),
    "a FLAC of 2e9 samples": ("walk", MAP, a_claim_of_samples),
    "frames until 10^12 s": ("frames", MAP, lambda folder: _frames(folder, 1e12)),
    "sources of NaN": ("run", LOCATE, arrays("map.npz", sources=np.array([np.nan]))),
    "encoders in a table": ("run", LOCATE, arrays("map.npz", payload_encoders=np.array([["a"]]))),
    "settings 5,000 deep": ("parameters.toml", SETTINGS, text("a = " + "[" * 5000)),
    "a world 5,000 deep": ("world.toml", SHOW, text("a = " + "[" * 5000)),
    "a place 5,000 deep": (
        "place.toml",
        "export {base}/run {out} --to imdf --origin 47,8 --place {given}",
        text("a = " + "[" * 5000),
    ),
    "a recording 200,000 deep": (
        "walk",
        MAP,
        lambda folder: text("[" * 200_000)(folder / "recording.json"),
    ),
    "no coordinates": ("plan.geojson", PLAN, corners([])),
    "coordinates in braces": ("plan.geojson", PLAN, corners({})),
    "coordinates of 10^400": ("plan.geojson", PLAN, corners([[[10**400, 0]] * 4])),
    "a ring of 200,000 corners": ("plan.geojson", PLAN, corners(a_ring(200_000))),
    "3,000 rings on each other": (
        "plan.geojson",
        PLAN,
        text(json.dumps({"type": "MultiPolygon", "coordinates": [a_ring(20)] * 3000})),
    ),
    "figures of another study": (
        "elf.csv",
        "card --measured {given} --out {out}",
        text('{"format_version": 1}'),
    ),
    "an archive of devices": ("mall.tar.xz", MALL, an_archive_of(tarfile.CHRTYPE)),
    "an archive without walks": ("mall.tar.xz", MALL, an_archive_without_walks),
    "an encoder that loops": ("encoder.onnx", WITH_ENCODER, encoder(LOOPS)),
    "an encoder that grows": ("encoder.onnx", WITH_ENCODER, encoder(GROWS)),
    "an encoder that takes all memory": ("encoder.onnx", WITH_ENCODER, encoder(ALLOCATES)),
    "an encoder that fails": ("encoder.onnx", WITH_ENCODER, encoder(FAILS)),
    **{
        f"an encoder of other vectors: {name}": ("encoder.onnx", WITH_ENCODER, encoder(nodes))
        for name, nodes in OTHERS.items()
    },
}


def _frames(folder: Path, last_s: float) -> None:
    lines = (folder / "frames.csv").read_text().splitlines()
    text("\n".join([*lines[:-1], repr(last_s)]))(folder / "frames.csv")


@pytest.mark.parametrize("name", ATTACKS)
def test_what_is_known_is_refused_in_a_line(
    base: Path, commands: Commands, tmp_path: Path, name: str
) -> None:
    given, arguments, attack = ATTACKS[name]
    copy = copied(base, given, tmp_path)
    attack(copy)
    ended, faults = run(commands, Target("known", given, arguments), copy, base, tmp_path)
    assert (faults, ended.code) == ([], 2), ended


@pytest.mark.parametrize(
    "arguments",
    [
        "simulate studio {out} --rounds 1000000000",
        "simulate studio {out} --day " + "9" * 5000,
        "simulate {base}/world.toml {out} --people 1000000000",
        "simulate {base}/world.toml {out} --jitter inf",
        "map {base}/quiet {out} --start 1e400,0,0",
        "map {base}/quiet {out} --set closure.threshold=" + "[" * 5000,
        "export {base}/run {out} --to ros --resolution 1e-9",
        "export {base}/run {out} --to geojson --origin nan,8",
        "anchor {base}/run {base}/plan.png:1e300 {out}",
    ],
)
def test_numbers_that_nothing_can_hold_are_refused(
    base: Path, commands: Commands, tmp_path: Path, arguments: str
) -> None:
    copy = copied(base, "place.toml", tmp_path)
    result = "out.yaml" if "--to ros" in arguments else "out"
    target = Target("known", "place.toml", arguments, result)
    ended, faults = run(commands, target, copy, base, tmp_path)
    assert (faults, ended.code) == ([], 2), ended
