"""What logs of other programs have in common: folders, archives, clocks, gravity, attitude."""

import io
import lzma
import struct
import tarfile
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.base.bounds import FREE_BYTES, RATIO, check_claim
from elfslam.base.errors import InputError
from elfslam.base.geometry import rotation_from_quaternion
from elfslam.base.text_files import readable
from elfslam.base.values import Imu, Orientation, Recording, Truth
from elfslam.base.zips import opened_zip, unpack_zip
from elfslam.data.sensor_files import CLOCK_SLACK_S, GRAVITY_MPS2, gravity_in
from elfslam.data.tables import in_order

TEXT_ENDING = ".txt"
MOST_MEMBERS = 100_000
BROKEN = (
    tarfile.TarError,
    lzma.LZMAError,
    struct.error,
    EOFError,
    OSError,
    ValueError,
    OverflowError,
    LookupError,
)
"""What tarfile and lzma let through of an archive that was cut off, overwritten or made up."""


def check_archive(path: Path) -> None:
    """Raises InputError where an archive is broken, holds no text or what is no plain file."""
    if sum(1 for _ in texts_in(path)) == 0:
        raise InputError(f"{path}: holds no walk; wanted {TEXT_ENDING} files")


def texts_in(path: Path) -> Iterator[tuple[str, bytes]]:
    """Name and content of each text in an archive, in its order. Raises InputError."""
    file_bytes = path.stat().st_size
    try:
        with (
            lzma.open(path) as unpacked,
            tarfile.open(
                fileobj=_Bounded(unpacked, FREE_BYTES + RATIO * file_bytes), mode="r|"
            ) as archive,
        ):
            for count, member in enumerate(archive):
                _check_member(path, member, count, file_bytes)
                content = archive.extractfile(member) if member.name.endswith(TEXT_ENDING) else None
                if content is not None:
                    yield PurePosixPath(member.name).name, content.read()
    except BROKEN as cause:
        raise InputError(f"{path}: is a broken archive ({cause!s:.120}); copy it again") from cause


class _Bounded(io.RawIOBase):
    """A stream that ends in an error once more came out of it than was allowed."""

    def __init__(self, stream: IO[bytes], left_bytes: int) -> None:
        self._stream, self._left_bytes = stream, left_bytes

    def read(self, size: int = -1, /) -> bytes:
        piece = self._stream.read(size)
        self._left_bytes -= len(piece)
        if self._left_bytes < 0:
            raise tarfile.ReadError("unpacks to more than can be believed")
        return piece


def _check_member(path: Path, member: tarfile.TarInfo, count: int, file_bytes: int) -> None:
    if count >= MOST_MEMBERS:
        raise InputError(f"{path}: has more than {MOST_MEMBERS} entries; cut it in parts")
    if member.issparse() or not (member.isfile() or member.isdir()):
        raise InputError(f"{path}: holds {member.name!r:.60}, which is no plain file; pack files")
    check_claim(path, f"{member.name!r:.60}", member.size, file_bytes)


ZIP_START, XZ_START = b"PK", b"\xfd7zXZ\x00"
MACOSX = "__MACOSX"
"""Where the Mac's zip program puts its own files."""


@dataclass(frozen=True, eq=False)
class Imported:
    """One recording, its truth where the log has it, and how many lines were damaged."""

    recording: Recording
    truth: Truth | None = None
    damaged_lines: int = 0


def starts_with(path: Path, start: bytes) -> bool:
    """Whether a file begins with these bytes; false of what is no file."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(len(start)) == start


def is_zip(path: Path) -> bool:
    """Whether a file is a .zip, whatever it is called."""
    return starts_with(path, ZIP_START)


def is_clutter(name: PurePosixPath) -> bool:
    """Whether that is a file which systems put beside others: hidden, or of the Mac's zips."""
    return MACOSX in name.parts or name.name.startswith(".")


def name_of(path: Path) -> str:
    """What the recording of a log is called: as its folder or its file, without the ending."""
    return readable(path.name if path.is_dir() else path.stem)


def one_of_each(folder: Path, endings: Collection[str]) -> dict[str, Path]:
    """The files of these endings in the folder of one log, by their names in small letters.

    Programs write a file per sensor, whatever folders are packed around them: two of one name
    are of two recordings. Raises InputError then.
    """
    found: dict[str, Path] = {}
    for file in sorted(folder.rglob("*")):
        name, inside = file.name.lower(), PurePosixPath(file.relative_to(folder))
        if file.suffix.lower() not in endings or is_clutter(inside) or not file.is_file():
            continue
        if name in found:
            twice = [f"{each!s:.60}" for each in (found[name].relative_to(folder), inside)]
            raise InputError(
                f"{folder}: holds several recordings ({', '.join(twice)}), wanted one; give each "
                "alone"
            )
        found[name] = file
    return found


@contextmanager
def log_folder(path: Path) -> Iterator[Path]:
    """The folder of a log: `path` itself, or its .zip unpacked for a moment.

    An InputError from inside names `path`, and no folder that is gone by then.
    """
    if path.is_dir():
        yield path
        return
    with tempfile.TemporaryDirectory() as name:
        unpack_zip(path, Path(name))
        try:
            yield Path(name)
        except InputError as cause:
            raise InputError(str(cause).replace(name, str(path))) from None


def files_in(path: Path, ending: str) -> Iterator[Path]:
    """The files of that ending in a folder or a .zip, by name, or else the file `path` itself.

    One from a .zip is unpacked for a moment: its path is good until the next is asked for.
    Raises InputError where there is none.
    """
    if path.is_dir():
        inside = sorted(file for file in path.rglob("*") if _is_wanted(file, ending))
        if not inside:
            raise InputError(f"{path}: holds no {ending} file; give the folder of the logs")
        yield from inside
    elif is_zip(path):
        yield from _unpacked(path, ending)
    else:
        yield path


def _is_wanted(name: Path | PurePosixPath, ending: str) -> bool:
    return name.suffix.lower() == ending and not is_clutter(PurePosixPath(name))


def _unpacked(path: Path, ending: str) -> Iterator[Path]:
    with opened_zip(path) as packed, tempfile.TemporaryDirectory() as folder:
        wanted = sorted(name for name in packed.entries if _is_wanted(name, ending))
        if not wanted:
            raise InputError(f"{path}: holds no {ending} file; pack the logs themselves")
        for name in wanted:
            file = Path(folder) / name.name
            packed.unpack(packed.entries[name], file)
            yield file
            file.unlink()


STANDARD_GRAVITY_MPS2, GRAVITY_G = 9.80665, (0.8, 1.25)
STEPS_SHARE = 0.4
"""Of the steps along an axis; what varies less in strength than by that is gravity alone."""
MOST_DAMAGED_ROWS, LOOKED_AT_ROWS = 10, 32
"""So many rows out of order, among those before and behind a step back, are damage; where both
sides have more of them the clock itself was put back."""
MOST_JUMPS = 100
LONG_PAUSE_S, MOST_PAUSES_TOLD = 10.0, 10
LARGEST_TILT_RAD = 0.5
"""An attitude whose vertical is further from the measured one is not understood."""
CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])

Stream = tuple[F64, F64]
"""Times (n), as a log has them, and values (n, ...)."""


@dataclass(frozen=True, eq=False)
class Clock:
    """The clock of a log as stretches between which it was put back.

    `spans_s` (k, 2) are the first and the last time of each as the log has them, `added_s` (k)
    what has to be added to its times. `notes` tell of the jumps.
    """

    spans_s: F64
    added_s: F64
    notes: tuple[str, ...] = ()

    def running(self, t_s: F64) -> F64:
        """Times (n) of any stream of the log, in its order, as if nobody had put the clock back."""
        return t_s + self.added_s[self._stretches(t_s)]

    def _stretches(self, t_s: F64) -> I64:
        """In which stretch each row (n) lies: in the same as before while that can be."""
        found = np.zeros(len(t_s), dtype=np.int64)
        if len(self.added_s) == 1:
            return found
        now, last_s = 0, -np.inf
        for row, time_s in enumerate(t_s):
            if last_s - time_s > self._half_back_s(now) or not self._holds(now, time_s):
                later = range(now + 1, len(self.added_s))
                now = next((k for k in later if self._holds(k, time_s)), now)
            if self._holds(now, time_s):
                last_s = time_s
            found[row] = now
        return found

    def _holds(self, stretch: int, time_s: float) -> bool:
        first_s, last_s = self.spans_s[stretch]
        return bool(first_s - CLOCK_SLACK_S <= time_s <= last_s + CLOCK_SLACK_S)

    def _half_back_s(self, stretch: int) -> float:
        """Half of what the clock is put back by behind a stretch: rows in disorder go less."""
        if stretch + 1 == len(self.added_s):
            return np.inf
        return float(self.spans_s[stretch, 1] - self.spans_s[stretch + 1, 0]) / 2


def clock_of(source: str, t_s: F64) -> Clock:
    """The clock of a log, from the times (n) of its densest stream.

    A few rows that leap and come back are damage and tell nothing. Behind a lasting step back
    the stream is taken to have run on. Raises InputError, starting with `source`, for times that
    are no clock.
    """
    steps_s = np.diff(t_s)
    period_s = float(np.median(steps_s[steps_s > 0])) if (steps_s > 0).any() else 0.0
    begins = [0, *(int(k) for k in np.flatnonzero(steps_s < 0) + 1 if _is_put_back(t_s, int(k)))]
    if len(begins) > MOST_JUMPS:
        raise InputError(f"{source}: its clock was put back over {MOST_JUMPS} times; repair it")
    back_s = np.array([t_s[k - 1] - t_s[k] for k in begins[1:]])
    added_s = np.concatenate([[0.0], np.cumsum(back_s + period_s)])
    ends = [*begins[1:], len(t_s)]
    spans_s = np.array(
        [(t_s[a:b].min(), t_s[a:b].max()) for a, b in zip(begins, ends, strict=True)]
    )
    notes = [
        f"the clock was put back by {back:.2f} s at {t_s[k - 1] + added - t_s[0]:.2f} s; what "
        f"follows is kept, {period_s:.3f} s behind what came before"
        for k, back, added in zip(begins[1:], back_s, added_s[:-1], strict=True)
    ]
    running_s = t_s + np.repeat(added_s, np.diff([*begins, len(t_s)]))
    return Clock(spans_s, added_s, (*notes, *_pauses(running_s)))


def _is_put_back(t_s: F64, row: int) -> bool:
    before, behind = t_s[max(row - LOOKED_AT_ROWS, 0) : row], t_s[row : row + LOOKED_AT_ROWS]
    overtaken, late = np.sum(before > t_s[row]), np.sum(behind < t_s[row - 1])
    return bool(min(overtaken, late) > MOST_DAMAGED_ROWS)


def _pauses(t_s: F64) -> list[str]:
    """What is told of long steps ahead, which are kept as gaps."""
    kept_s = t_s[in_order(t_s)]
    gaps_s = np.diff(kept_s)
    if (count := int(np.sum(gaps_s > LONG_PAUSE_S))) > MOST_PAUSES_TOLD:
        return [f"nothing was measured for over {LONG_PAUSE_S:g} s, {count} times; all is kept"]
    return [
        f"nothing was measured for {gaps_s[k]:.1f} s from {kept_s[k] - t_s[0]:.2f} s on, or the "
        "clock was put forward; both parts are kept, with that gap"
        for k in np.flatnonzero(gaps_s > LONG_PAUSE_S)
    ]


def ordered(t_s: F64, values: F64, clock: Clock) -> tuple[Stream, int]:
    """The rows whose time does not go backward on that clock, and how many others there were."""
    t_s = clock.running(t_s)
    kept = in_order(t_s)
    return (t_s[kept], values[kept]), int(np.sum(~kept))


def rising(t_s: F64, values: F64) -> Stream:
    """The rows of an ordered stream without those that repeat a time."""
    kept = np.diff(t_s, prepend=-np.inf) > 0
    return t_s[kept], values[kept]


def on_one_clock(streams: Mapping[str, Stream], clock: Clock) -> tuple[dict[str, Stream], int]:
    """All streams of a log with rising times on its clock; how many rows were out of order."""
    kept = {name: ordered(*stream, clock) for name, stream in streams.items()}
    found = {name: rising(*stream) for name, (stream, _) in kept.items()}
    return found, sum(left_out for _, left_out in kept.values())


def with_gravity(streams: Sequence[Stream], unit_mps2: float | None = None) -> Stream:
    """Of the accelerations of one phone, at least one, that with gravity and steps, in m/s2.

    No name tells it: apps measure it with gravity, without, and gravity alone, in any language.
    The latter two are added up where nothing else is there. `unit_mps2` is the unit that is
    stated; else g is meant where gravity is then as strong as it is. What has no gravity anywhere
    is given as it came: `imu_on_accelerometer_clock` refuses it.
    """
    units = [_unit_mps2(stream, unit_mps2) for stream in streams]
    heavy = [(each, unit) for each, unit in zip(streams, units, strict=True) if unit is not None]
    light = [each for each, unit in zip(streams, units, strict=True) if unit is None]
    if not heavy:
        return streams[0]
    (t_s, values), unit = max(heavy, key=lambda each: _unsteadiness(each[0][1]) * each[1])
    if light and _unsteadiness(values) < STEPS_SHARE * float(np.sqrt(np.mean(light[0][1] ** 2))):
        gravity, (t_s, steps) = (t_s, values), light[0]
        values = steps + np.column_stack(
            [np.interp(t_s, gravity[0], axis) for axis in gravity[1].T]
        )
    return t_s, values * unit


def _unsteadiness(values: F64) -> float:
    """By how much the strength of an acceleration varies: that of gravity alone does not."""
    return float(np.std(np.linalg.norm(values, axis=1)))


def _unit_mps2(stream: Stream, stated: float | None) -> float | None:
    """The unit of an acceleration in which its gravity is one; None where it has none."""
    low, high = GRAVITY_MPS2
    strength = gravity_in(*stream)
    if stated is None and GRAVITY_G[0] <= strength <= GRAVITY_G[1]:
        return STANDARD_GRAVITY_MPS2
    unit = stated or 1.0
    return unit if low <= strength * unit <= high else None


def attitude_that_agrees(t_s: F64, candidates: Sequence[F64], imu: Imu) -> Orientation | None:
    """The reading of a quaternion, x y z w, whose vertical is that of the accelerometer.

    Programs differ in the order of its parts and in which way it turns: every candidate (n, 4)
    is tried both ways. None where none agrees.
    """
    up = np.column_stack([np.interp(t_s, imu.t_s, axis) for axis in imu.accel_mps2.T])
    turned = [_unit(each * way) for each in candidates for way in (np.ones(4), CONJUGATE)]
    tilts = [_tilt_rad(each, up) for each in turned]
    if not min(tilts) < LARGEST_TILT_RAD:
        return None
    return Orientation(t_s, turned[int(np.argmin(tilts))])


def _unit(quaternion: F64) -> F64:
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.asarray(quaternion / np.where(length > 0, length, np.nan))


def _tilt_rad(world_from_phone: F64, up: F64) -> float:
    """Angle between the vertical and the mean measured acceleration turned into the world."""
    if not np.isfinite(world_from_phone).all():
        return np.inf
    turned = np.einsum("nij,nj->ni", rotation_from_quaternion(world_from_phone), up).mean(axis=0)
    length = np.linalg.norm(turned)
    return float(np.arccos(np.clip(turned[2] / length, -1, 1))) if length > 0 else np.inf
