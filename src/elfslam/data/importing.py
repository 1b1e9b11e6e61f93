"""Other people's logs as recordings with their truth: one list of formats, told by content.

Beside each reader stands the test by which its files are known, made of the reader's own parts:
what is recognised is what is read. A log is never told by what it is called.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property, partial
from itertools import islice
from pathlib import Path, PurePosixPath
from zipfile import ZipInfo

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.text_files import read_bytes
from elfslam.base.values import Recording
from elfslam.base.zips import Zip, opened_zip
from elfslam.data import log_files
from elfslam.data.getsensordata import is_getsensordata, read_getsensordata
from elfslam.data.magnetic import MAT_START, SHAPES, names_in_mat, read_magnetic
from elfslam.data.mall import is_walk, read_walk, walks_in
from elfslam.data.phyphox import is_phyphox, read_phyphox
from elfslam.data.recordings import MANIFEST
from elfslam.data.ronin import is_ronin, read_ronin
from elfslam.data.sensorlogger import is_sensorlogger, read_sensorlogger
from elfslam.data.tables import separator_of

HEAD_BYTES = 2**16
MOST_FILES, MOST_TEXTS, MOST_LINES = 10_000, 5, 1000
"""So many are looked at: files of a folder, texts of an archive, lines of a text."""


class LogFormat(StrEnum):
    """Formats that can be imported."""

    MALL = "mall"
    MAGNETIC = "magnetic"
    SENSORLOGGER = "sensorlogger"
    PHYPHOX = "phyphox"
    GETSENSORDATA = "getsensordata"
    RONIN = "ronin"


@dataclass(frozen=True)
class LogFile:
    """A file of a log as a format is told by it; it is read once its beginning is wanted."""

    name: PurePosixPath
    source: Path
    start: Callable[[], bytes]
    content: Callable[[], bytes]

    @cached_property
    def lines(self) -> list[str]:
        """The first lines of a text, the last of them perhaps cut off; at least one."""
        text = self.start().decode("utf-8-sig", errors="replace").lstrip()
        return text.splitlines()[:MOST_LINES] or [""]

    @property
    def columns(self) -> list[str]:
        """The names of a table's columns."""
        first = self.lines[0]
        return [cell.strip().strip('"').strip() for cell in first.split(separator_of(first))]

    @property
    def is_magnetic(self) -> bool:
        """Whether it is a .mat file with the arrays of a magnetic walk. Raises InputError."""
        is_mat = self.start().startswith(MAT_START)
        return is_mat and set(SHAPES) <= names_in_mat(self.content(), self.source)


@dataclass(frozen=True)
class LogReader:
    """How logs of one program are known and read.

    `is_mine` tells one of its files, which end in `ending`. `walks` gives the files, each of one
    walk, at a path that may hold many; without it all files there are of one recording. Only
    programs that play chirps have the echoes of them in their sound.
    """

    title: str
    ending: str
    is_mine: Callable[[LogFile], bool]
    read: Callable[[Path, np.random.Generator], log_files.Imported]
    walks: Callable[[Path], Iterator[Path]] | None = None
    plays_chirps: bool = False


FORMATS: Mapping[LogFormat, LogReader] = {
    LogFormat.MALL: LogReader(
        "a walk of the mall data set",
        ".txt",
        lambda file: is_walk(file.lines),
        lambda path, _: read_walk(path),
        walks=walks_in,
    ),
    LogFormat.MAGNETIC: LogReader(
        "a magnetic walk",
        ".mat",
        lambda file: file.is_magnetic,
        lambda path, generator: log_files.Imported(*read_magnetic(path, generator)),
        walks=partial(log_files.files_in, ending=".mat"),
    ),
    LogFormat.SENSORLOGGER: LogReader(
        "a recording of Sensor Logger",
        ".csv",
        lambda file: is_sensorlogger(file.columns),
        lambda path, _: read_sensorlogger(path),
    ),
    LogFormat.PHYPHOX: LogReader(
        "an export of phyphox",
        ".csv",
        lambda file: is_phyphox(file.columns),
        lambda path, _: read_phyphox(path),
        plays_chirps=True,
    ),
    LogFormat.GETSENSORDATA: LogReader(
        "a log of GetSensorData",
        ".txt",
        lambda file: is_getsensordata(file.lines),
        lambda path, _: read_getsensordata(path),
        walks=partial(log_files.files_in, ending=".txt"),
    ),
    LogFormat.RONIN: LogReader(
        "a log of RoNIN",
        ".txt",
        lambda file: is_ronin(file.name, file.lines),
        lambda path, _: read_ronin(path),
    ),
}
OWN = "a recording of elfslam"
"""What is no log."""
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


@dataclass(frozen=True)
class Refused:
    """A log among many that could not be read, and why."""

    name: str
    reason: str


def declared_start(item: log_files.Imported) -> Recording:
    """The recording that begins where its first waypoint says, as who walked it would declare.

    It leaves the heading open. Raises InputError where there is no waypoint.
    """
    if item.truth is None:
        raise InputError(f"{item.recording.name}: has no waypoint that tells its start")
    x_m, y_m = item.truth.world_from_body[0, :2]
    return replace(item.recording, start_pose=(float(x_m), float(y_m), np.nan))


def read_logs(
    log_format: LogFormat, path: Path, generator: np.random.Generator
) -> Iterator[log_files.Imported | Refused]:
    """Every recording at `path`; `generator` drifts odometry that would else be the truth.

    Raises InputError where `path` itself is no log of that format, or a broken archive.
    """
    known = FORMATS[log_format]
    if known.walks is None:
        yield known.read(path, generator)
        return
    for file in known.walks(path):
        try:
            item = known.read(file, generator)
        except InputError as error:
            if file == path:
                raise
            yield Refused(file.name, str(error).replace(f"{file.parent}/", ""))
            continue
        yield item


def takes_many(log_format: LogFormat, path: Path) -> bool:
    """Whether there may be several recordings of this format at `path`."""
    if log_format is LogFormat.MALL:
        return True
    return FORMATS[log_format].walks is not None and (path.is_dir() or log_files.is_zip(path))


def recognise(path: Path) -> LogFormat | None:
    """The format of a log: a file or a folder; None of a recording of this program.

    Raises InputError, saying what it is instead, where it is none that can be read, or several.
    """
    if not path.exists():
        raise InputError(f"{path}: does not exist; wanted a log, check the path")
    alone = not path.is_dir() and not _head(path).startswith(
        (log_files.ZIP_START, log_files.XZ_START)
    )
    names: list[PurePosixPath] = []
    signs: dict[LogFormat | None, PurePosixPath] = {}
    for file in _files_of(path):
        names.append(file.name)
        for kind in _kinds(file, alone=alone):
            signs.setdefault(kind, file.name)
    if not signs:
        said = _said_of(_head(path)) if alone else _said_of_names(names)
        raise InputError(f"{path}: {said}; {WANTED}")
    if len(signs) > 1:
        found = " and ".join(f"{_title(kind)} ({name})" for kind, name in signs.items())
        raise InputError(f"{path}: holds {found}, wanted one of them; give each alone")
    [kind] = signs
    if alone and kind is not None and FORMATS[kind].walks is None:
        raise InputError(
            f"{path}: is one file of {_title(kind)}, wanted all of them; give the .zip that holds "
            "them"
        )
    return kind


def _kinds(file: LogFile, *, alone: bool) -> Iterator[LogFormat | None]:
    """Of which formats a file is a sign; None is our own. Among others its ending counts."""
    if file.name.name == MANIFEST and not alone:
        yield None
    for kind, known in FORMATS.items():
        if (alone or file.name.suffix.lower() == known.ending) and known.is_mine(file):
            yield kind


def _title(kind: LogFormat | None) -> str:
    return OWN if kind is None else FORMATS[kind].title


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(HEAD_BYTES)


def _files_of(path: Path) -> Iterator[LogFile]:
    if path.is_dir():
        inside = (file for file in sorted(path.rglob("*")) if file.is_file())
        for file in islice(inside, MOST_FILES):
            name = PurePosixPath(file.relative_to(path))
            if not log_files.is_clutter(name):
                yield from _texts(file) if name.name.endswith(".tar.xz") else [_file(name, file)]
    elif log_files.starts_with(path, log_files.ZIP_START):
        yield from _entries(path)
    elif log_files.starts_with(path, log_files.XZ_START):
        yield from _texts(path)
    else:
        yield _file(PurePosixPath(path.name), path)


def _file(name: PurePosixPath, file: Path) -> LogFile:
    return LogFile(name, file, partial(_head, file), partial(read_bytes, file))


def _texts(path: Path) -> Iterator[LogFile]:
    for name, text in islice(log_files.texts_in(path), MOST_TEXTS):
        yield LogFile(
            PurePosixPath(name), path, partial(bytes, text[:HEAD_BYTES]), partial(bytes, text)
        )


def _entries(path: Path) -> Iterator[LogFile]:
    with opened_zip(path) as packed:
        for name, entry in packed.entries.items():
            if not log_files.is_clutter(name):
                start = partial(packed.start, entry, HEAD_BYTES)
                yield LogFile(name, path, start, partial(_all_of, packed, entry))


def _all_of(packed: Zip, entry: ZipInfo) -> bytes:
    return bytes(packed.content(entry))


def _said_of(head: bytes) -> str:
    for start, what in OTHERS.items():
        if head.startswith(start):
            return f"is {what}"
    if not head.strip():
        return "is empty"
    if head.startswith(MAT_START):
        return f"is a .mat file without {', '.join(SHAPES)}"
    if head.lstrip()[:1] in (b"{", b"["):
        return "is JSON, which is not read (export as .zip of CSV)"
    first = head[:200].decode("utf-8-sig", errors="replace").lstrip().split("\n")[0].strip()
    return f"begins with {first[:40]!r}, which no known log does"


def _said_of_names(names: Sequence[PurePosixPath]) -> str:
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
