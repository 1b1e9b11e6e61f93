"""Recordings as folders, or zips of them, that ordinary programs open.

`recording.json` says what it is; every sensor has its own file; the truth, where known, is
written beside them (`truth_files.py`) and never read here.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from elfslam import __version__
from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Recording, Truth
from elfslam.data.audio_files import FLAC, read_recorded_sound, write_audio
from elfslam.data.folders import new_folder, unpack_zip
from elfslam.data.sensor_files import (
    read_emr,
    read_imu,
    read_magnetometer,
    read_odometry,
    read_orientation,
    write_sensors,
)
from elfslam.data.truth_files import write_truth
from elfslam.data.wifi_table import read_wifi

FORMAT_VERSION = 1
MACOSX = "__MACOSX"
"""Where the Mac's zip program puts its own files."""
POSE = ("x_m", "y_m", "heading_rad")
FARTHEST_M = 1e6
MOST_LOST_SHARE = 0.1
"""A stream may lose some samples, which echo cutting recovers; more is a file that was cut off."""
MANIFEST = "recording.json"


def write_recording(
    recording: Recording,
    folder: Path,
    *,
    chirp_description: Mapping[str, object] | None = None,
    truth: Truth | None = None,
    start_utc: str | None = None,
) -> None:
    """The recording as a new folder. Raises StoreError where one with content is there."""
    with new_folder(folder) as partial:
        manifest = _manifest(recording, chirp_description, start_utc)
        text = json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False)
        (partial / MANIFEST).write_text(text + "\n", encoding="utf-8")
        if recording.audio is not None:
            write_audio(recording.audio, partial / FLAC)
        write_sensors(recording, partial)
        if truth is not None:
            write_truth(truth, partial)


def read_recording(path: Path) -> Recording:
    """The recording in a folder or a .zip of one.

    Raises InputError naming the file, and the row where there is one.
    """
    if path.is_dir():
        return _read_folder(path, path.name)
    if not path.is_file():
        raise InputError(f"{path}: does not exist; wanted a recording folder or a .zip of one")
    if path.suffix != ".zip":
        raise InputError(f"{path}: is no recording; wanted a folder or a .zip with {MANIFEST}")
    with tempfile.TemporaryDirectory() as name:
        unpack_zip(path, Path(name))
        try:
            return _read_folder(_folder_within(Path(name)), path.stem)
        except InputError as cause:
            raise InputError(str(cause).replace(name, str(path))) from None


def _folder_within(unpacked: Path) -> Path:
    inside = (file for file in sorted(unpacked.glob(f"*/{MANIFEST}")) if file.parent.name != MACOSX)
    manifests = [unpacked / MANIFEST, *inside]
    return next((file.parent for file in manifests if file.is_file()), unpacked)


def _manifest(
    recording: Recording, chirp: Mapping[str, object] | None, start_utc: str | None
) -> dict[str, object]:
    audio = recording.audio
    sound = None
    if audio is not None:
        channels, samples = audio.samples.shape
        sound = {"rate_hz": audio.rate_hz, "channels": channels, "samples": samples}
    return {
        "format_version": FORMAT_VERSION,
        "name": recording.name,
        "device": recording.device,
        "start_utc": start_utc,
        "start_pose": recording.start_pose,
        "chirp": None if chirp is None else dict(chirp),
        "audio": sound,
        "software": f"elfslam {__version__}",
    }


def _read_folder(folder: Path, name: str) -> Recording:
    manifest = _read_manifest(folder / MANIFEST)
    wifi = folder / "wifi.csv"
    return Recording(
        name=str(manifest.get("name") or name),
        device=str(manifest.get("device") or "unknown"),
        start_pose=_start_pose(folder / MANIFEST, manifest),
        audio=_read_sound(folder, manifest),
        imu=read_imu(folder),
        orientation=read_orientation(folder / "orientation.csv"),
        odometry=read_odometry(folder),
        magnetometer=read_magnetometer(folder / "magnetometer.csv"),
        wifi=read_wifi(wifi) if wifi.is_file() else None,
        emr=read_emr(folder / "emr.csv"),
    )


def _read_manifest(file: Path) -> dict[str, Any]:
    if not file.is_file():
        raise InputError(f"{file.parent}: is no recording; wanted a folder with {MANIFEST}")
    try:
        manifest = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as cause:
        raise InputError(f"{file}: cannot be read as JSON ({cause}); repair it") from cause
    version = manifest.get("format_version") if isinstance(manifest, dict) else None
    if isinstance(version, bool) or version != FORMAT_VERSION:
        raise InputError(
            f"{file}: format_version is {version!r}, wanted {FORMAT_VERSION}; "
            "use a newer elfslam or convert the recording"
        )
    return dict(manifest)


def _start_pose(file: Path, manifest: dict[str, Any]) -> tuple[float, float, float] | None:
    given = manifest.get("start_pose")
    if given is None:
        return None
    numbers = isinstance(given, list) and all(type(number) in (int, float) for number in given)
    if not numbers or len(given) != len(POSE):
        raise InputError(f"{file}: start_pose is {given!r:.60}, wanted [{', '.join(POSE)}]")
    if not all(abs(number) < FARTHEST_M for number in given):
        raise InputError(f"{file}: start_pose {given!r:.60} is not finite; give three numbers")
    x_m, y_m, heading_rad = map(float, given)
    return x_m, y_m, heading_rad


def _read_sound(folder: Path, manifest: dict[str, Any]) -> Audio | None:
    audio = read_recorded_sound(folder)
    claimed = manifest.get("audio")
    if audio is None and claimed:
        raise InputError(f"{folder}: {MANIFEST} promises audio and none is there; copy it again")
    wanted = claimed.get("samples") if isinstance(claimed, dict) else None
    present = 0 if audio is None else audio.samples.shape[1]
    if isinstance(wanted, int) and present < (1 - MOST_LOST_SHARE) * wanted:
        raise InputError(
            f"{folder}: audio has {present} samples, {MANIFEST} promises {wanted}; "
            "the file is cut off, copy it again"
        )
    return audio
