"""What happens to files of a format: their headers claim, their contents are of another kind."""

import io
import json
import lzma
import random
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from damage import (
    ANYTHING,
    PLACES,
    Damage,
    a_cell,
    a_column,
    a_long_text,
    a_setting,
    a_value,
    changed,
    cut_off,
    flipped,
    its_lines,
    nested,
    zeroed,
)
from foreign_encoders import ALLOCATES, FAILS, GOOD, GROWS, LOOPS, OTHERS, foreign_encoder

ALLOWED_BYTES, LARGE_BYTES = 60 * 2**20, 200 * 2**20
"""Of what a small file unpacks to: as much as it may, and more."""


# Arrays.


def an_array(file: Path, chance: random.Random) -> None:
    """One array of an .npz is of another type, shape, size or content, or is none."""
    try:
        with np.load(file) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except Exception:
        return
    name = chance.choice(sorted(arrays))
    array = arrays[name]
    flat = array.astype(float) if array.dtype.kind in "biuf" else np.zeros(array.shape)
    others: list[Callable[[], Any]] = [
        lambda: np.full(array.shape, np.nan),
        lambda: np.full(array.shape, chance.choice((1e308, -1e308, 1e12, 1e6, -1, 0, 2**62))),
        lambda: np.where(np.arange(flat.size).reshape(flat.shape) == 0, 1e15, flat),
        lambda: array[:-1] if array.ndim else array[None],
        lambda: array[:0] if array.ndim else np.empty(0),
        lambda: array[None],
        array.ravel,
        lambda: np.concatenate([array, array]) if array.ndim else array,
        lambda: array.astype(str),
        lambda: np.array("\ud800") if chance.random() < 0.5 else np.array(["a\nb" * 99]),
        lambda: flat.astype(np.float16),
        lambda: flat.astype(np.complex128),
        lambda: np.array([{}]),
        lambda: flat[::-1],
        lambda: chance.random() * flat,
        lambda: np.resize(
            array, (int(ALLOWED_BYTES // (8 * max(array[:1].size, 1))), *array.shape[1:])
        ),
        lambda: np.zeros((2700, 2700)),
    ]
    with np.errstate(all="ignore"):
        arrays[name] = chance.choice(others)()
    if chance.random() < 0.1:
        del arrays[name]
    file.unlink()
    np.savez_compressed(file, **arrays)


def a_far_number(file: Path, chance: random.Random) -> None:
    """One number of an array, or all of them, lie far from where they were."""
    try:
        with np.load(file) as stored:
            arrays = {name: stored[name].copy() for name in stored.files}
    except Exception:
        return
    numbers = [name for name in sorted(arrays) if arrays[name].dtype.kind in "iuf"]
    array = arrays[chance.choice(numbers)]
    far = chance.choice((1e308, 1e15, 1e9, 1e6, 3e4, 3e3, -1e7, -3e3, 0.0, -1.0))
    with np.errstate(all="ignore"):
        if array.size and chance.random() < 0.5:
            array.flat[chance.randrange(array.size)] = np.float64(far).astype(array.dtype)
        else:
            array[...] = (array * far).astype(array.dtype)
    file.unlink()
    np.savez_compressed(file, **arrays)


def an_array_header(file: Path, chance: random.Random) -> None:
    """One array of an .npz claims another shape or type than it has."""
    try:
        with zipfile.ZipFile(file) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except Exception:
        return
    shape = chance.choice(("(1000000000000,)", "(0, 1000000000000)", "(-1,)", "()", "(3,)", "[3]"))
    descr = chance.choice(("'<f8'", "'|O'", "'<U100000'", "'<U0'", "[('a', '<f8')]", "'<i8'"))
    told = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    name = chance.choice(sorted(members))
    members[name] = (
        b"\x93NUMPY\x01\x00" + struct.pack("<H", 118) + told.encode() + members[name][128:]
    )
    _zip_again(file, members)


# Sound.


def a_sound_header(content: bytes, chance: random.Random) -> bytes:
    """A FLAC or WAV says that it is longer, of another rate, or of more channels than it is."""
    made = bytearray(content)
    number = chance.choice((0, 1, 44_101, 2_000_000_000, 2**32 - 1, chance.randrange(2**32)))
    if content[:4] == b"fLaC":
        if chance.random() < 0.6:
            made[21] = made[21] & 0xF0 | chance.choice((0, 0, 15))
            made[22:26] = struct.pack(">I", number)
        else:
            made[18:22] = struct.pack(">I", number)
    elif content[:4] == b"RIFF":
        at = chance.choice((4, 16, 20, 22, 24, 28, 32, 34, 40))
        size = 2 if at in (20, 22, 32, 34) else 4
        made[at : at + size] = struct.pack("<I", number)[:size]
    return bytes(made)


# Archives.


def _zip_again(
    file: Path, members: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED
) -> None:
    file.unlink()
    with zipfile.ZipFile(file, "w", method, compresslevel=1) as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def a_zip_entry(file: Path, chance: random.Random) -> None:
    """One entry of a zip is a trick."""
    try:
        with zipfile.ZipFile(file) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except Exception:
        return
    names = sorted(members)
    method = zipfile.ZIP_DEFLATED
    kind = chance.randrange(7)
    if kind == 0:
        row = chance.choice((b"\0", b"1\n", b",", b"\n", b"0,0,0,0\n", b"[1],", b"ab\n", b"# "))
        size = chance.choice((ALLOWED_BYTES, ALLOWED_BYTES, LARGE_BYTES))
        name = chance.choice(names)
        kept = members[name][: chance.choice((0, 40, len(members[name])))]
        members[name] = kept + row * (size // len(row))
    elif kind == 1:
        method = chance.choice((zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2))
    elif kind == 2:
        name = chance.choice(
            ("../a", "/a", "a\\b", "C:/a", "a" * 300, "a/" * 300 + "b", names[0] + "/a")
        )
        members[name] = b"x"
    elif kind == 3:
        members |= {f"{k}.txt": b"" for k in range(2000)}
    elif kind == 4:
        members.pop(chance.choice(names))
    elif kind == 5:
        name = chance.choice(names)
        members[name] = chance.choice((a_cell, cut_off, its_lines, flipped))(members[name], chance)
    else:
        members |= {f"copy/{name}": content for name, content in members.items()}
    _zip_again(file, members, method)


def zip_directory(count: int) -> bytes:
    """The directory of so many entries, and no entry: 46 bytes each."""
    entry = struct.pack("<4s6H3L5H2L", b"PK\x01\x02", *[0] * 16)
    ends = (b"PK\x05\x06", 0, 0, count & 0xFFFF, count & 0xFFFF, count * len(entry), 0, 0)
    return entry * count + struct.pack("<4s4H2LH", *ends)


def changed_lzma(name: str, content: bytes) -> bytes:
    """A zip of a file that is packed by LZMA, of which one byte is another."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr(name, content)
    packed = bytearray(made.getvalue())
    packed[60] ^= 0xFF
    return bytes(packed)


def a_zip_directory(content: bytes, chance: random.Random) -> bytes:
    """The directory of a zip claims another size, place, method, kind or number of entries."""
    made = bytearray(content)
    number = struct.pack("<I", chance.choice((0, 1, 100, 2**31, 2**32 - 1)))
    entry, end = content.rfind(b"PK\x01\x02"), content.rfind(b"PK\x05\x06")
    kind = chance.randrange(5)
    if kind == 4:
        return zip_directory(1_000_000)
    if entry < 0 or end < 0:
        return content
    if kind == 0:
        made[entry + 24 : entry + 28] = number
    elif kind == 1:
        made[end + 12 : end + 16] = number
    elif kind == 2:
        at = chance.choice((8, 10))
        made[entry + at : entry + at + 2] = struct.pack("<H", chance.choice((1, 9, 12, 14, 95)))
    else:
        made[entry + 38 : entry + 42] = struct.pack("<I", chance.choice((0o120777, 0o020666)) << 16)
    return bytes(made)


def a_tar(file: Path, chance: random.Random) -> None:
    """The archive holds what is no plain file, or unpacks to more than it should."""
    kind = chance.randrange(8)
    with tarfile.open(file.with_name("made"), "w:xz", preset=0) as archive:
        info = tarfile.TarInfo("walk.txt")
        if kind < 4:
            info.type = (tarfile.CHRTYPE, tarfile.FIFOTYPE, tarfile.SYMTYPE, tarfile.BLKTYPE)[kind]
            info.linkname = "/etc/passwd"
            archive.addfile(info)
        elif kind == 4:
            info.size = LARGE_BYTES
            archive.addfile(info, io.BytesIO(bytes(LARGE_BYTES)))
        elif kind == 5:
            for k in range(chance.choice((0, 3, 2000))):
                archive.addfile(tarfile.TarInfo(f"{k}.json"))
        elif kind == 6:
            archive.addfile(tarfile.TarInfo("../../" + "a" * 300 + ".txt"))
        else:
            info.size = 2**40
            archive.addfile(info)
    file.unlink()
    file.with_name("made").rename(file)


def inside_xz(content: bytes, chance: random.Random) -> bytes:
    try:
        whole = lzma.decompress(content)
    except lzma.LZMAError:
        return content
    return lzma.compress(chance.choice((flipped, zeroed, a_cell, cut_off))(whole, chance), preset=0)


# Pictures and encoders.


def a_picture_header(content: bytes, chance: random.Random) -> bytes:
    """A PNG of other sides and kinds."""
    if content[:4] != b"\x89PNG":
        return content
    sides = [chance.choice((0, 1, 5000, 40_000, 2**31 - 1)) for _ in range(2)]
    kind = bytes([chance.choice((1, 8, 16)), chance.choice((0, 2, 3, 4, 6)), 0, 0, 0])
    head = (
        b"IHDR" + struct.pack(">II", *sides) + (kind if chance.random() < 0.5 else content[24:29])
    )
    return content[:12] + head + struct.pack(">I", zlib.crc32(head)) + content[33:]


def a_large_picture(content: bytes, chance: random.Random) -> bytes:
    """Millions of pixels in a few bytes: white, black or noise."""
    width, height = chance.choice(((6000, 6000), (30_000, 1000), (1500, 1500), (1, 1_000_000)))
    made = random.Random(chance.random())
    rows = chance.choice((b"\xff", b"\x00", b"")) * (width // 8)
    body = b"".join(b"\x00" + (rows or made.randbytes(width // 8)) for _ in range(height))

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    head = struct.pack(">IIBBBBB", width // 8 * 8 or 1, height, 1, 0, 0, 0, 0)
    if width < 8:
        body = b"\x00\xff" * height
    parts = [chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(body, 1)), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def an_encoder(content: bytes, chance: random.Random) -> bytes:
    """A graph that looks like an encoder and misbehaves while it runs."""
    nodes = chance.choice((LOOPS, GROWS, ALLOCATES, FAILS, GOOD, *OTHERS.values()))
    return foreign_encoder(*nodes)


# Plans.

CORNERS: Sequence[Any] = (
    [], {}, None, [[]], [[[]]], [{}], "a", [[[0, 0], [1, 1]]], [[["a", 0], [1, 0], [1, 1], [0, 0]]],
    [[[8.5, 47.3], [8.5001, 47.3], [8.5001, 47.3001], [8.5, 47.3]], []],
    [[[0, 90], [1e-5, 90], [1e-5, 89.9999], [0, 90]]], 
    [[[180, 0], [-180, 0], [-180, 1e-4], [180, 0]]],
    [[[10**400, 0], [1, 0], [1, 1], [0, 0]]], [[[8.5, 47.3]] * 4], [[[8.5, 47.3, 1, 2, 3]] * 9],
)  # fmt: skip


def a_polygon(content: bytes, chance: random.Random) -> bytes:
    """Plans of all kinds: without corners, with countless ones, at the poles, on each other."""
    kind = chance.randrange(4)
    if kind == 0:
        corners = chance.choice(CORNERS)
    elif kind == 1:
        turn = np.linspace(0, 2 * np.pi, chance.choice((3000, 60_000, 200_000)))
        wide = 1e-3 * (1 + 0.1 * np.sin(turn * chance.choice((3, 501))))
        ring = np.column_stack([8.5 + wide * np.cos(turn), 47.3 + wide * np.sin(turn)])
        corners = [ring.tolist()]
    elif kind == 2:
        places = [[8.5 + chance.random() * 1e-3, 47.3 + chance.random() * 1e-3] for _ in range(500)]
        corners = [[*places, places[0]]]
    else:
        square = [[8.5, 47.3], [8.51, 47.3], [8.51, 47.31], [8.5, 47.31], [8.5, 47.3]]
        shape = {"type": "MultiPolygon", "coordinates": [[square]] * chance.choice((9, 3000))}
        return json.dumps(shape).encode()
    told = {"type": chance.choice(("Polygon", "Polygon", "MultiPolygon")), "coordinates": corners}
    feature = {"type": "Feature", "geometry": told, "properties": chance.choice(({}, None, []))}
    return json.dumps({"type": "FeatureCollection", "features": [feature]}).encode()


TEXT = tuple(map(changed, (a_cell, a_cell, a_column, a_column, its_lines, a_long_text)))
DOCUMENT = tuple(map(changed, (nested, a_long_text)))
SOME = tuple(map(changed, (a_value, a_value, a_value)))
ZIPPED = (a_zip_entry, a_zip_entry, changed(a_zip_directory))
BY_ENDING: Mapping[str, tuple[Damage, ...]] = {
    ".csv": TEXT,
    ".tum": TEXT,
    ".txt": TEXT,
    ".json": (*SOME, *DOCUMENT),
    ".geojson": (*SOME, *DOCUMENT, *[changed(a_polygon)] * 4),
    ".toml": (*[changed(a_setting)] * 6, *DOCUMENT),
    ".npz": (*[an_array] * 3, *[a_far_number] * 3, an_array_header, an_array_header, *ZIPPED),
    ".flac": (*[changed(a_sound_header)] * 3,),
    ".wav": (*[changed(a_sound_header)] * 3,),
    ".zip": ZIPPED,
    ".png": (*[changed(a_picture_header)] * 2, *[changed(a_large_picture)] * 2),
    ".onnx": (*[changed(an_encoder)] * 6,),
    ".svg": (*[changed(a_value)] * 2, changed(a_long_text)),
    ".xz": (a_tar, a_tar, changed(inside_xz), changed(inside_xz)),
}


def damages_of(file: Path) -> tuple[Damage, ...]:
    """What may happen to a file of that name; what is its own happens as often as all else."""
    own = BY_ENDING.get(file.suffix, ())
    common = (*ANYTHING, *PLACES)
    return (*common, *own * max(len(common) // max(len(own), 1), 1))
