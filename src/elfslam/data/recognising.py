"""Which program wrote a log: told by what is in it, never by what it is called."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path, PurePosixPath

from elfslam.base.errors import InputError
from elfslam.base.text_files import read_bytes
from elfslam.base.zips import opened_zip
from elfslam.data import ronin
from elfslam.data.importing import LogFormat
from elfslam.data.log_files import XZ_START, ZIP_START, is_clutter
from elfslam.data.magnetic import SHAPES
from elfslam.data.mat_files import MAT_START, names_in_mat
from elfslam.data.phyphox import TIME, UNITS
from elfslam.data.recordings import MANIFEST
from elfslam.data.tars import texts_in

OWN = "recording"
"""What is no log but a recording of this program."""
NAMES: Mapping[str, str] = {
    OWN: "a recording of elfslam",
    LogFormat.MALL: "a walk of the mall data set",
    LogFormat.MAGNETIC: "a magnetic walk",
    LogFormat.SENSORLOGGER: "a recording of Sensor Logger",
    LogFormat.PHYPHOX: "an export of phyphox",
    LogFormat.GETSENSORDATA: "a log of GetSensorData",
    LogFormat.RONIN: "a log of RoNIN",
}
WANTED = (
    "wanted a recording of elfslam (.zip), or one of Sensor Logger (.zip), phyphox (.zip of CSV), "
    "GetSensorData (.txt), RoNIN (.zip), the mall data set (.txt, .tar.xz) or the magnetic walks "
    "(.mat); export it as that"
)
OTHERS = {
    b"%PDF": "a PDF",
    b"\x89PNG": "an image",
    b"\xff\xd8\xff": "an image",
    b"\x89HDF": "an HDF5 file",
    b"MATLAB 7.3": "a .mat file of version 7.3 (save it as -v7)",
    b"SQLite format 3": "an SQLite database (export as .zip)",
    b"7z\xbc\xaf": "a .7z archive (pack it as .zip)",
    b"Rar!": "a .rar archive (pack it as .zip)",
    b"\x1f\x8b": "a .gz archive (pack it as .zip)",
    b"RIFF": "sound alone",
    b"fLaC": "sound alone",
}
"""What people may give instead, by how it begins."""
HEAD_BYTES = 2**16
MOST_FILES, MOST_TEXTS, MOST_LINES = 10_000, 5, 1000
"""So many are looked at: files of a folder, texts of an archive, lines of a text."""
MALL_LINE = re.compile(r"\d{1,13}\tTYPE_[A-Z_]+\t")
GETSENSORDATA_LINE = re.compile(r"(ACCE|GYRO|MAGN|AHRS|PRES|WIFI|SOUN|LIGH|POSI);\s*[\d.,]+\s*;")
RONIN_LINE = re.compile(r"\d{5,20}(\.0*)?([ \t]+[-+.\deE]+){3,4}\s*$")
TABLES, TEXTS = ".csv", ".txt"

Signs = dict[str, list[PurePosixPath]]
"""Of which formats there are signs, and in which files."""


def recognise(path: Path) -> LogFormat | None:
    """The format of a log: a file or a folder; None of a recording of this program.

    Raises InputError, saying what it is instead, where it is none that can be read, or several.
    """
    if path.is_dir():
        signs, others = _of_folder(path)
    elif path.is_file():
        with path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
        signs, others = _of_file(path, head)
    else:
        raise InputError(f"{path}: does not exist; wanted a log, check the path")
    if not signs:
        raise InputError(f"{path}: {others}; {WANTED}")
    if len(signs) > 1:
        found = " and ".join(f"{NAMES[kind]} ({files[0]})" for kind, files in signs.items())
        raise InputError(f"{path}: holds {found}, wanted one of them; give each alone")
    [(kind, files)] = signs.items()
    if kind in (LogFormat.SENSORLOGGER, LogFormat.PHYPHOX):
        _refuse_several(path, files)
    return None if kind == OWN else LogFormat(kind)


def _of_file(path: Path, head: bytes) -> tuple[Signs, str]:
    if head.startswith(ZIP_START):
        return _of_zip(path)
    if head.startswith(XZ_START):
        return _of_archive(path), "is an archive without walks of the mall data set"
    return _of_single(path, head), _said_of(head)


def _refuse_several(path: Path, files: Sequence[PurePosixPath]) -> None:
    """These have one file per sensor: two of one name are of two recordings."""
    [(name, count)] = Counter(file.name for file in files).most_common(1)
    if count > 1:
        twice = [str(file) for file in files if file.name == name]
        raise InputError(
            f"{path}: holds several recordings ({twice[0]:.60}, {twice[1]:.60}), wanted one; "
            "give each alone"
        )


def _of_zip(path: Path) -> tuple[Signs, str]:
    """Signs in the files of a .zip, and else what they are."""
    signs: Signs = defaultdict(list)
    with opened_zip(path) as packed:
        names = [name for name in packed.entries if not is_clutter(name)]
        for name in names:
            entry = packed.entries[name]
            head = packed.start(entry, HEAD_BYTES) if _is_telling(name) else b""
            for kind in _kinds(name, head):
                signs[kind].append(name)
            if head.startswith(MAT_START) and _is_magnetic(bytes(packed.content(entry)), path):
                signs[LogFormat.MAGNETIC].append(name)
    return signs, _said_of_names(names)


def _of_folder(path: Path) -> tuple[Signs, str]:
    signs: Signs = defaultdict(list)
    files = islice((file for file in sorted(path.rglob("*")) if file.is_file()), MOST_FILES)
    names = []
    for file in files:
        name = PurePosixPath(file.relative_to(path))
        if is_clutter(name):
            continue
        names.append(name)
        for kind in _kinds_of_file(file, name):
            signs[kind].append(name)
    return signs, _said_of_names(names)


def _kinds_of_file(file: Path, name: PurePosixPath) -> Iterator[str]:
    """Signs in a file of a folder."""
    with file.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    yield from _kinds(name, head)
    if head.startswith(XZ_START) and name.name.endswith(".tar.xz"):
        yield from _of_archive(file)
    if head.startswith(MAT_START) and _is_magnetic(read_bytes(file), file):
        yield LogFormat.MAGNETIC


def _of_archive(path: Path) -> Signs:
    """Signs in the first texts of an archive; only the mall data set comes as one."""
    signs: Signs = {}
    for name, content in islice(texts_in(path), MOST_TEXTS):
        if LogFormat.MALL in _kinds_of_text(content[:HEAD_BYTES]):
            signs.setdefault(LogFormat.MALL, []).append(PurePosixPath(name))
    return signs


def _of_single(path: Path, head: bytes) -> Signs:
    """Signs in a file that is a log by itself. Raises InputError for a part of one."""
    name = PurePosixPath(path.name)
    if head.startswith(MAT_START):
        return {LogFormat.MAGNETIC: [name]} if _is_magnetic(read_bytes(path), path) else {}
    parts = {*_kinds_of_table(head), *(_kinds_of_ronin(head) if name.name in RONIN_FILES else ())}
    if parts:
        whole = NAMES[min(parts)]
        raise InputError(
            f"{path}: is one file of {whole}, wanted all of them; give the .zip that holds them"
        )
    return {kind: [name] for kind in _kinds_of_text(head)}


RONIN_FILES = (ronin.ACCELEROMETER, ronin.GYROSCOPE, ronin.MAGNETOMETER, *ronin.ATTITUDES)


def _is_telling(name: PurePosixPath) -> bool:
    """Whether one has to look into a file."""
    return name.suffix.lower() in (TABLES, TEXTS, ".mat")


def _kinds(name: PurePosixPath, head: bytes) -> set[str]:
    """Of which formats a file among others is a sign."""
    if name.name == MANIFEST:
        return {OWN}
    if name.suffix.lower() == TABLES:
        return _kinds_of_table(head)
    if name.name in RONIN_FILES:
        return _kinds_of_ronin(head)
    return _kinds_of_text(head) if name.suffix.lower() == TEXTS else set()


def _kinds_of_table(head: bytes) -> set[str]:
    """What the names of a table's columns tell."""
    line = _lines(head)[0] if head.strip() else ""
    columns = [cell.strip().strip('"').strip() for cell in re.split(r"[,;\t]", line)]
    kinds: set[str] = set()
    if "seconds_elapsed" in columns:
        kinds.add(LogFormat.SENSORLOGGER)
    units = [unit for unit, _ in UNITS.values()]
    measured = any(unit.search(column) for unit in units for column in columns)
    if measured and any(TIME.match(column) for column in columns):
        kinds.add(LogFormat.PHYPHOX)
    return kinds


def _kinds_of_text(head: bytes) -> set[str]:
    """What the lines of a text tell."""
    told = {LogFormat.MALL: MALL_LINE, LogFormat.GETSENSORDATA: GETSENSORDATA_LINE}
    lines = _lines(head)
    return {kind for kind, line in told.items() if any(map(line.match, lines))}


def _kinds_of_ronin(head: bytes) -> set[str]:
    rows = [line for line in _lines(head)[:-1] if not line.startswith("#")]
    return {LogFormat.RONIN} if any(map(RONIN_LINE.match, rows)) else set()


def _lines(head: bytes) -> list[str]:
    """The first lines of a text, the last of them perhaps cut off; at least one."""
    text = head.decode("utf-8-sig", errors="replace").lstrip()
    return text.split("\n", MOST_LINES)[:MOST_LINES]


def _is_magnetic(content: bytes, path: Path) -> bool:
    return set(SHAPES) <= names_in_mat(content, path)


def _said_of(head: bytes) -> str:
    """What a file is that is no log."""
    for start, what in OTHERS.items():
        if head.startswith(start):
            return f"is {what}"
    if not head.strip():
        return "is empty"
    if head.startswith(MAT_START):
        return f"is a .mat file without {', '.join(SHAPES)}"
    if head.lstrip()[:1] in (b"{", b"["):
        return "is JSON, which is not read (export as .zip of CSV)"
    first = _lines(head[:200])[0].strip()
    return f"begins with {first[:40]!r}, which no known log does"


def _said_of_names(names: Iterable[PurePosixPath]) -> str:
    """What files are that make up no log."""
    shown = [str(name) for name in names]
    if any(name.startswith("xl/") for name in shown):
        return "is an Excel file (export as CSV, with any separator)"
    if any(name.lower().endswith(".zip") for name in shown):
        return "holds other .zip files (give each alone)"
    if not shown:
        return "holds no file"
    more = f" and {len(shown) - 3} more" if len(shown) > 3 else ""
    return (
        f"holds {', '.join(f'{name:.40}' for name in shown[:3])}{more}, which are of no known log"
    )
