"""Recordings as folders, or zips of them, that ordinary programs open.

`recording.json` says what it is; every sensor has its own file; the truth, where known, is
written beside them (`truth_files.py`) and never read here.
"""

import json
import math
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from elfslam import __version__
from elfslam.base.arguments import checked
from elfslam.base.arrays import F64
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_json
from elfslam.base.values import Audio, Recording, Truth
from elfslam.base.zips import unpack_zip
from elfslam.data import sensor_files
from elfslam.data.atomic_files import new_folder
from elfslam.data.audio_files import FLAC, at_accepted_rate, read_recorded_sound, write_audio
from elfslam.data.baseband import Baseband, write_baseband
from elfslam.data.log_files import MACOSX, name_of
from elfslam.data.named_places import LONGEST_S, read_checkpoints, write_checkpoints
from elfslam.data.tables import check_size, read_header, read_timed_table, write_timed_table
from elfslam.data.truth_files import write_truth
from elfslam.stages.chirp import ChirpParameters, describe_chirp

CHIRPS = "chirps.csv"
GAIN = "gain_db"
MOST_DB = 100.0


def write_schedule(played_t_s: F64, gain_db: F64 | None, folder: Path) -> None:
    """The moments (n) at which chirps began to be played, and how loud (n), into `folder`."""
    columns = [] if gain_db is None else [GAIN]
    values = np.empty((len(played_t_s), 0)) if gain_db is None else gain_db[:, None]
    write_timed_table(folder / CHIRPS, columns, played_t_s, values)


def read_schedule(folder: Path) -> tuple[F64 | None, F64 | None]:
    """When the chirps of a recording were played (n), and how loud (n, dB).

    None where nobody says. Raises InputError.
    """
    file = folder / CHIRPS
    if not file.is_file():
        return None, None
    columns = [GAIN] if GAIN in read_header(file) else []
    t_s, values = read_timed_table(file, columns)
    check_size(file, t_s[:, None], LONGEST_S, "s")
    check_size(file, values, MOST_DB, "dB")
    return t_s, values[:, 0] if columns else None


FORMAT_VERSION = 1
POSE = ("x_m", "y_m", "heading_rad")
MOST_LOST_SHARE = 0.1
"""A stream may lose some samples, which echo cutting recovers; more is a file that was cut off."""
MANIFEST = "recording.json"
MOST_NOTES, LONGEST_NOTE = 200, 500


def write_recording(
    recording: Recording,
    folder: Path,
    *,
    chirp_description: Mapping[str, object] | None = None,
    truth: Truth | None = None,
    baseband: Baseband | None = None,
) -> None:
    """The recording as a new folder, its sound as `baseband` where that is given.

    Raises StoreError where a folder with content is there.
    """
    with new_folder(folder) as partial:
        manifest = _manifest(recording, chirp_description)
        if baseband is not None:
            manifest |= {"audio": None, "baseband": write_baseband(baseband, partial)}
        text = json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False)
        (partial / MANIFEST).write_text(text + "\n", encoding="utf-8")
        if recording.audio is not None and baseband is None:
            write_audio(recording.audio, partial / FLAC)
        sensor_files.write_sensors(recording, partial)
        if recording.played_t_s is not None:
            write_schedule(recording.played_t_s, recording.gain_db, partial)
        if recording.checkpoints is not None:
            write_checkpoints(recording.checkpoints, partial)
        if truth is not None:
            write_truth(truth, partial)


@checked
def read_recording(path: Path | str, chirp: ChirpParameters | None = None) -> Recording:
    """The recording in a folder or a .zip of one.

    Its sound is refused where recording.json says that another excitation was played than
    `chirp`, by default the pipeline's own. Raises InputError naming the file, and the row where
    there is one.
    """
    path = Path(path)
    with recording_folder(path) as folder:
        try:
            return _read_folder(folder, name_of(path), chirp or ChirpParameters())
        except InputError as cause:
            raise InputError(str(cause).replace(str(folder), str(path))) from None


@contextmanager
def recording_folder(path: Path) -> Iterator[Path]:
    """The folder of a recording: `path` itself, or its .zip unpacked for a moment.

    Raises InputError where there is none.
    """
    if path.is_dir():
        yield path
        return
    if not path.is_file():
        raise InputError(f"{path}: does not exist; wanted a recording folder or a .zip of one")
    if path.suffix != ".zip":
        raise InputError(f"{path}: is no recording; wanted a folder or a .zip with {MANIFEST}")
    with tempfile.TemporaryDirectory() as name:
        unpack_zip(path, Path(name))
        yield _folder_within(Path(name))


def _folder_within(unpacked: Path) -> Path:
    inside = (file for file in sorted(unpacked.glob(f"*/{MANIFEST}")) if file.parent.name != MACOSX)
    manifests = [unpacked / MANIFEST, *inside]
    return next((file.parent for file in manifests if file.is_file()), unpacked)


def _manifest(recording: Recording, chirp: Mapping[str, object] | None) -> dict[str, object]:
    audio = recording.audio
    sound = None
    if audio is not None:
        channels, samples = audio.samples.shape
        sound = {"rate_hz": audio.rate_hz, "channels": channels, "samples": samples}
    return {
        "format_version": FORMAT_VERSION,
        "name": recording.name,
        "device": recording.device,
        "start_utc": None,
        "start_pose": _declared(recording.start_pose),
        "chirp": None if chirp is None else dict(chirp),
        "audio": sound,
        "software": f"elfslam {__version__}",
        "notes": list(recording.notes),
    }


def _read_folder(folder: Path, name: str, chirp: ChirpParameters) -> Recording:
    manifest = _read_manifest(folder / MANIFEST)
    wifi = folder / "wifi.csv"
    played_t_s, gain_db = read_schedule(folder)
    audio = _read_sound(folder, manifest, chirp)
    recording = Recording(
        name=str(manifest.get("name") or name),
        device=str(manifest.get("device") or "unknown"),
        start_pose=_start_pose(folder / MANIFEST, manifest),
        audio=audio and at_accepted_rate(audio),
        imu=sensor_files.read_imu(folder),
        orientation=sensor_files.read_orientation(folder / "orientation.csv"),
        odometry=sensor_files.read_odometry(folder),
        magnetometer=sensor_files.read_magnetometer(folder / "magnetometer.csv"),
        barometer=sensor_files.read_barometer(folder / "barometer.csv"),
        wifi=sensor_files.read_wifi(wifi) if wifi.is_file() else None,
        emr=sensor_files.read_emr(folder / "emr.csv"),
        played_t_s=played_t_s,
        gain_db=gain_db,
        checkpoints=read_checkpoints(folder),
    )
    notes = (
        *_notes(folder / MANIFEST, manifest),
        *(recording.audio.notes if recording.audio else ()),
    )
    recording = replace(recording, notes=tuple(dict.fromkeys(notes)))
    _check_clocks(folder, recording)
    return recording


def _check_clocks(folder: Path, recording: Recording) -> None:
    """Refuse motion that is not that of the sound.

    Sound with times of its own may begin long before or after the motion: both are on its clock.
    """
    audio = recording.audio
    if audio is None:
        return
    sound = "sound", np.array([0.0, audio.samples.shape[1] / audio.rate_hz])
    slack_s = math.inf if audio.is_timed else sensor_files.CLOCK_SLACK_S
    if recording.imu is not None:
        motion = "motion sensors", recording.imu.t_s
        sensor_files.check_shared_time(str(folder), sound, motion, slack_s=slack_s)
    if recording.odometry is not None:
        odometry = "odometry", recording.odometry.t_s
        sensor_files.check_shared_time(str(folder), sound, odometry, slack_s=slack_s)


def _read_manifest(file: Path) -> dict[str, Any]:
    if not file.is_file():
        raise InputError(f"{file.parent}: is no recording; wanted a folder with {MANIFEST}")
    manifest = read_json(file)
    version = manifest.get("format_version") if isinstance(manifest, dict) else None
    if isinstance(version, bool) or version != FORMAT_VERSION:
        raise InputError(
            f"{file}: format_version is {version!r:.60}, wanted {FORMAT_VERSION}; "
            "use a newer elfslam or convert the recording"
        )
    return dict(manifest)


def _start_pose(file: Path, manifest: dict[str, Any]) -> tuple[float, float, float] | None:
    given = manifest.get("start_pose")
    if given is None:
        return None
    numbers = isinstance(given, list) and all(type(number) in (int, float) for number in given)
    if not numbers or len(given) not in (2, len(POSE)):
        wanted = f"[{', '.join(POSE)}], or without {POSE[2]}"
        raise InputError(f"{file}: start_pose is {given!r:.60}, wanted {wanted}")
    if not all(abs(number) < FARTHEST_M for number in given):
        raise InputError(f"{file}: start_pose {given!r:.60} is not finite; give three numbers")
    x_m, y_m, heading_rad = map(float, [*given, math.nan][: len(POSE)])
    return x_m, y_m, heading_rad


def _notes(file: Path, manifest: dict[str, Any]) -> list[str]:
    notes = manifest.get("notes", [])
    texts = isinstance(notes, list) and all(isinstance(note, str) for note in notes)
    if not texts or len(notes) > MOST_NOTES or any(len(note) > LONGEST_NOTE for note in notes):
        raise InputError(
            f"{file}: notes are {notes!r:.60}, wanted a list of at most {MOST_NOTES} texts of up "
            f"to {LONGEST_NOTE} characters; repair it"
        )
    return list(notes)


def _declared(start: tuple[float, float, float] | None) -> list[float] | None:
    return None if start is None else [number for number in start if math.isfinite(number)]


def _read_sound(folder: Path, manifest: dict[str, Any], chirp: ChirpParameters) -> Audio | None:
    audio = read_recorded_sound(folder, manifest.get("baseband"))
    claimed = manifest.get("audio")
    if audio is None and (claimed or manifest.get("baseband")):
        raise InputError(f"{folder}: {MANIFEST} promises audio and none is there; copy it again")
    if audio is None:
        return None
    _check_chirp(folder / MANIFEST, manifest.get("chirp"), chirp)
    if not isinstance(claimed, dict):
        return audio
    rate_hz, wanted = claimed.get("rate_hz", audio.rate_hz), claimed.get("samples")
    if rate_hz != audio.rate_hz:
        raise InputError(
            f"{folder}: audio has {audio.rate_hz} samples/s, {MANIFEST} promises {rate_hz!r:.30}; "
            "correct the one that is wrong"
        )
    present = audio.samples.shape[1]
    if audio.is_timed:  # frames end with the last that was kept, wherever the walk ended
        return audio
    if isinstance(wanted, int) and present / (1 - MOST_LOST_SHARE) < wanted:
        raise InputError(
            f"{folder}: audio has {present} samples, {MANIFEST} promises {wanted}; "
            "the file is cut off, copy it again"
        )
    return audio


def _check_chirp(file: Path, given: object, wanted: ChirpParameters) -> None:
    """Refuse sound of which recording.json says that something else was played."""
    if given is None:
        return
    if not isinstance(given, dict):
        raise InputError(f"{file}: chirp is {given!r:.60}, wanted an object; repair it")
    for name, value in describe_chirp(wanted).items():
        if name in given and not _same(given[name], value):
            raise InputError(
                f"{file}: chirp.{name} is {given[name]!r:.60}, the pipeline listens for {value!r}; "
                "set the chirp parameters to what was played, or record again"
            )


def _same(given: object, wanted: object) -> bool:
    if isinstance(wanted, list):
        if not isinstance(given, list) or len(given) != len(wanted):
            return False
        return all(map(_same, given, wanted))
    if isinstance(wanted, float):
        return isinstance(given, int | float) and math.isclose(given, wanted)
    return given == wanted
