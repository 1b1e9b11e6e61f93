"""Recordings on disk: round trips, and one line that names what is wrong."""

import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
import soundfile

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Recording, Truth
from elfslam.data.recordings import read_recording, write_recording
from elfslam.stages.chirp import ChirpParameters


def assert_same(read: Recording, wanted: Recording) -> None:
    assert (read.name, read.device, read.start_pose) == ("hall", "test phone", (1.0, -2.0, 0.5))
    assert read.audio.rate_hz == wanted.audio.rate_hz
    np.testing.assert_allclose(read.audio.samples, wanted.audio.samples, atol=2e-7)
    np.testing.assert_allclose(read.imu.t_s, wanted.imu.t_s, atol=1e-6)
    np.testing.assert_allclose(read.imu.accel_mps2, wanted.imu.accel_mps2, rtol=1e-8)
    np.testing.assert_allclose(read.imu.gyro_radps, wanted.imu.gyro_radps, rtol=1e-8)
    attitude = wanted.orientation.world_from_phone
    np.testing.assert_allclose(read.orientation.world_from_phone, attitude, atol=1e-8)
    np.testing.assert_allclose(read.magnetometer.t_s, wanted.magnetometer.t_s, atol=1e-6)
    np.testing.assert_allclose(read.magnetometer.field_ut, wanted.magnetometer.field_ut, rtol=1e-8)
    np.testing.assert_allclose(read.emr.amplitude, wanted.emr.amplitude, rtol=1e-8)
    assert read.wifi.bssids == wanted.wifi.bssids
    np.testing.assert_allclose(read.wifi.rssi_dbm, wanted.wifi.rssi_dbm)
    np.testing.assert_allclose(read.wifi.age_s, wanted.wifi.age_s)
    poses = wanted.odometry.world_from_body
    np.testing.assert_allclose(read.odometry.world_from_body, poses, atol=1e-8)
    np.testing.assert_allclose(read.odometry.step_sigma, wanted.odometry.step_sigma, rtol=1e-8)


@pytest.fixture
def folder(tmp_path: Path, recording: Recording) -> Path:
    write_recording(recording, tmp_path / "hall", chirp_description={"kind": "chirp"})
    return tmp_path / "hall"


def test_folder_round_trip(folder: Path, recording: Recording) -> None:
    assert_same(read_recording(folder), recording)
    assert json.loads((folder / "recording.json").read_text())["chirp"] == {"kind": "chirp"}


@pytest.mark.parametrize("inside", [".", "hall"])
def test_zip_round_trip(tmp_path: Path, folder: Path, recording: Recording, inside: str) -> None:
    root = folder if inside == "." else tmp_path
    made = shutil.make_archive(str(tmp_path.parent / tmp_path.name), "zip", root)
    assert_same(read_recording(Path(made)), recording)


@pytest.mark.parametrize("gain_db", [None, -4.0 * (np.arange(40) % 3 == 0)])
def test_times_and_gains_of_chirps_make_a_round_trip(tmp_path: Path, gain_db: F64 | None) -> None:
    played_s = 0.1 * np.arange(40) + 0.0125 * np.sin(np.arange(40))
    walk = Recording("hall", "phone", played_t_s=played_s, gain_db=gain_db)
    write_recording(walk, tmp_path / "hall")
    read = read_recording(tmp_path / "hall")
    np.testing.assert_allclose(read.played_t_s, played_s, atol=1e-6)
    np.testing.assert_array_equal(read.gain_db, gain_db)
    head = "t_s\n" if gain_db is None else "t_s,gain_db\n"
    assert (tmp_path / "hall" / "chirps.csv").read_text().startswith(head)


def test_same_recording_gives_same_bytes(tmp_path: Path, recording: Recording) -> None:
    for name in ("a", "b"):
        write_recording(recording, tmp_path / name)
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes(), file.name


def test_truth_is_written_not_read(tmp_path: Path, recording: Recording, truth: Truth) -> None:
    write_recording(recording, tmp_path / "with", truth=truth)
    assert (tmp_path / "with" / "truth.tum").is_file()
    (tmp_path / "with" / "truth.tum").write_text("not numbers")
    assert_same(read_recording(tmp_path / "with"), recording)


def test_gyroscope_moves_to_the_accelerometers_clock(folder: Path) -> None:
    rows = [f"{t:.3f},{2 * t:.6f},{-t:.6f},1" for t in np.arange(0.105, 1.5, 0.01)]
    (folder / "gyroscope.csv").write_text("t_s,x,y,z\n" + "\n".join(rows) + "\n")
    imu = read_recording(folder).imu
    assert imu.t_s[0] == 0.12
    assert imu.t_s[-1] <= 1.495
    np.testing.assert_allclose(imu.gyro_radps[:, 0], 2 * imu.t_s, atol=1e-6)


def test_odometry_without_sigmas_gets_assumed_ones(folder: Path) -> None:
    (folder / "odometry_sigma.csv").unlink()
    (folder / "odometry.tum").write_text("0 0 0 0 0 0 0 1\n1 10 0 0 0 0 0 1\n2 10 0 0 0 0 0 1\n")
    sigma = read_recording(folder).odometry.step_sigma
    np.testing.assert_allclose(sigma, [[0.2, 0.2, 0.005], [0.005, 0.005, 0.005]])


ROW = "t_s,x,y,z\n0,1,2,3\n"
DAMAGES = {
    "gyroscope.csv": {
        "t_s,x,y\n0,1,2\n": "column z is missing",
        ROW + "1,nan,2,3\n": "row 3 has 'nan'",
        ROW + "\n1,1,2,3\n": "row 3 has",
        ROW + "1,1,2,inf\n": "row 3 has 'inf'",
        ROW + "1,fast,2,3\n": "row 3 has 'fast'",
        ROW + "1,,2,3\n": "row 3 has ''",
        ROW + "1,1,2,3\n2,1,2\n": "row 4 has 3 cells, wanted 4",
        ROW + "2,1,2,3\n1,1,2,3\n": "time runs backward at row 4",
        ROW + "0,1,2,3\n": "time repeats at row 3",
        "t_s,x,y,z\n": "no rows",
        "": "is empty",
    },
    "recording.json": {
        "{": "is no JSON",
        "[]": "format_version is None, wanted 1",
        '{"format_version": 2}': "format_version is 2, wanted 1",
        '{"format_version": 1, "start_pose": [1]}': "start_pose is",
        '{"format_version": 1, "start_pose": {"x": 1}}': "start_pose is",
        '{"format_version": 1, "start_pose": [true, 0, 0]}': "start_pose",
        '{"format_version": 1, "start_pose": ["a", 2, 3]}': "start_pose is",
        '{"format_version": 1, "start_pose": [NaN, 2, 3]}': "holds nan, wanted finite",
        '{"format_version": 1, "audio": {"samples": 90000}}': "promises 90000",
        f'{{"format_version": 1, "audio": {{"samples": {10**400}}}}}': "whole number beyond",
    },
    "chirps.csv": {
        "t_s\n0.1\n0.1\n": "time repeats at row 3",
        "t_s\n0.1\n2e6\n": r"row 3 has 2e\+06 s, wanted at most 1e\+06",
        "t_s,gain_db\n0.1,-4\n0.2,loud\n": "row 3 has 'loud', wanted a finite",
        "t_s,gain_db\n0.1,-4\n0.2,-300\n": "row 3 has -300 dB, wanted at most 100",
    },
    "orientation.csv": {
        "t_s,qx,qy,qz,qw\n0,0,0,0,1\n1,0,0,0,2\n": "row 3 has a quaternion of length 2"
    },
    "odometry.tum": {
        "0 0 0 0 0 0 0 1\n1 10 0 0 0 0 0 1\n": "5 rows for 2 poses",
        "0 1e300 0 0 0 0 0 1\n": r"row 1 has 1e\+300 m",
    },
    "accelerometer.csv": {"t_s,x,y,z\n0,1,1e160,1\n": r"row 2 has 1e\+160"},
    "emr.csv": {"t_s,h1\n0,1\n1,1e300\n": r"row 3 has 1e\+300 microvolts"},
    "wifi.csv": {"t_s,bssid,rssi_dbm,age_s\n0,a,-1e300,\n": r"row 2 has -1e\+300"},
    "magnetometer.csv": {"t_s,x,y,z\n0,1,1e300,1\n": r"row 2 has 1e\+300"},
}
"""By file and content: what is said of it."""


@pytest.mark.parametrize(
    ("file", "text"), [(file, text) for file in DAMAGES for text in DAMAGES[file]]
)
def test_damaged_files_are_refused(folder: Path, file: str, text: str) -> None:
    (folder / file).write_text(text)
    with pytest.raises(InputError, match=DAMAGES[file][text]) as refused:
        read_recording(folder)
    assert file.split(".", maxsplit=1)[0] in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("absent", "says"),
    [
        ("audio.flac", "promises audio and none is there"),
        ("gyroscope.csv", "gyroscope.csv is missing"),
        ("accelerometer.csv", "accelerometer.csv is missing"),
        ("recording.json", "is no recording"),
    ],
)
def test_absent_files_are_refused(folder: Path, absent: str, says: str) -> None:
    (folder / absent).unlink()
    with pytest.raises(InputError, match=says):
        read_recording(folder)


@pytest.mark.parametrize("kept", [0, 30, 2000, -1500])
def test_cut_off_flac_is_refused(folder: Path, kept: int) -> None:
    content = (folder / "audio.flac").read_bytes()
    (folder / "audio.flac").write_bytes(content[:kept])
    with pytest.raises(InputError, match=r"audio\.flac"):
        read_recording(folder)


def test_cut_off_wav_is_refused(folder: Path, recording: Recording) -> None:
    (folder / "audio.flac").unlink()
    sound = (recording.audio.samples.T * 32767).astype("<i2").tobytes()
    form = struct.pack("<IHHIIHH", 16, 1, 2, 44_100, 176_400, 4, 16)
    body = b"WAVEfmt " + form + b"data" + struct.pack("<I", len(sound)) + sound
    whole = b"RIFF" + struct.pack("<I", len(body)) + body
    (folder / "audio.wav").write_bytes(whole)
    assert read_recording(folder).audio.samples.shape == (2, 22_050)
    (folder / "audio.wav").write_bytes(whole[:-400])
    with pytest.raises(InputError, match=r"audio\.wav: is cut off"):
        read_recording(folder)


def test_missing_path_and_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_recording(tmp_path / "nothing")
    (tmp_path / "song.mp3").write_bytes(b"x")
    with pytest.raises(InputError, match="is no recording"):
        read_recording(tmp_path / "song.mp3")


def test_broken_zip_is_refused(tmp_path: Path, folder: Path) -> None:
    made = Path(shutil.make_archive(str(tmp_path / "walk"), "zip", folder))
    content = made.read_bytes()
    for damaged in (b"", content[:500], content[:200] + bytes(400) + content[600:]):
        made.write_bytes(damaged)
        with pytest.raises(InputError, match=r"walk\.zip: the \.zip is not whole"):
            read_recording(made)


def test_errors_within_a_zip_name_the_zip(tmp_path: Path, folder: Path) -> None:
    (folder / "emr.csv").write_text("t_s,h1\n0,a\n")
    made = Path(shutil.make_archive(str(tmp_path / "walk"), "zip", folder))
    with pytest.raises(InputError, match=r"walk\.zip/emr\.csv: row 2"):
        read_recording(made)


def timed(t_s: np.ndarray, values: tuple[float, float, float] = (0.0, 0.0, 9.8)) -> str:
    cells = ",".join(map(str, values))
    return "t_s,x,y,z\n" + "".join(f"{t:.3f},{cells}\n" for t in t_s)


T_S = np.arange(0, 40, 0.02)


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    """Forty seconds of motion without sound."""
    write_recording(Recording("walk", "phone"), tmp_path / "walk")
    (tmp_path / "walk" / "accelerometer.csv").write_text(timed(T_S))
    (tmp_path / "walk" / "gyroscope.csv").write_text(timed(T_S, (0, 0, 0.1)))
    return tmp_path / "walk"


def test_a_pause_of_the_gyroscope_alone_is_a_pause_of_the_motion(motion: Path) -> None:
    kept = (T_S <= 10) | (T_S >= 20)
    (motion / "gyroscope.csv").write_text(timed(T_S[kept]))
    imu = read_recording(motion).imu
    np.testing.assert_allclose(imu.t_s, T_S[kept], atol=1e-9)
    assert np.diff(imu.t_s).max() == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("t_s", "says"),
    [
        (T_S * 1000, r"gyroscope has 0\.\d samples/s, wanted at least 20"),
        (T_S + 5, "do not overlap enough"),
        (T_S[:1], "do not overlap enough"),
        (T_S[::20], "gyroscope has 2.5 samples/s, wanted at least 20"),
    ],
    ids=["milliseconds", "late", "one row", "slow"],
)
def test_a_gyroscope_of_another_clock_fails(motion: Path, t_s: np.ndarray, says: str) -> None:
    (motion / "gyroscope.csv").write_text(timed(t_s))
    with pytest.raises(InputError, match=says) as refused:
        read_recording(motion)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("strength", [0.0, 1.0, 40.0])
def test_accelerations_without_gravity_are_refused(motion: Path, strength: float) -> None:
    (motion / "accelerometer.csv").write_text(timed(T_S, (0, 0, strength)))
    with pytest.raises(InputError, match=r"gravity .* is .* m/s2, wanted 5 to 15"):
        read_recording(motion)


@pytest.fixture
def heard(motion: Path) -> Path:
    """The same with its sound."""
    soundfile.write(motion / "audio.flac", np.zeros(40 * 44_100), 44_100)
    assert read_recording(motion).audio is not None
    return motion


@pytest.mark.parametrize(
    "t_s",
    [T_S[1000:], T_S + 1.7e9, T_S + 20, T_S - 1000, T_S + 3],
    ids=["second half", "epoch", "late", "early", "a little late"],
)
def test_motion_that_is_not_that_of_the_sound_is_refused(heard: Path, t_s: np.ndarray) -> None:
    for name in ("accelerometer.csv", "gyroscope.csv"):
        (heard / name).write_text(timed(t_s))
    with pytest.raises(InputError, match=r"sound \(0\.0 to 40\.0 s\) and motion .*one clock"):
        read_recording(heard)


@pytest.mark.parametrize("t_s", [T_S[:1000], T_S * 1.2], ids=["early", "late"])
def test_motion_may_end_before_the_sound_or_after_it(heard: Path, t_s: np.ndarray) -> None:
    for name in ("accelerometer.csv", "gyroscope.csv"):
        (heard / name).write_text(timed(t_s))
    np.testing.assert_allclose(read_recording(heard).imu.t_s, t_s, atol=1e-3)


@pytest.mark.parametrize("t_s", [T_S[1000:], T_S + 20, T_S[:1000]], ids=["late", "later", "early"])
def test_frames_carry_the_clock_of_the_motion(motion: Path, t_s: np.ndarray) -> None:
    """A walk may begin or end without its motion, and end long before it was promised to."""
    frames = np.zeros(400 * 3528)
    soundfile.write(motion / "frames.wav", frames, 44_100, subtype="PCM_16")
    times = "".join(f"{0.1 * k:.9f}\n" for k in range(400))
    (motion / "frames.csv").write_text("t_s\n" + times)
    said(motion, audio={"rate_hz": 44_100, "samples": 90 * 44_100})
    for name in ("accelerometer.csv", "gyroscope.csv"):
        (motion / name).write_text(timed(t_s))
    recording = read_recording(motion)
    assert recording.audio.is_timed
    np.testing.assert_allclose(recording.imu.t_s, t_s, atol=1e-3)


def said(folder: Path, **entries: object) -> None:
    """Changes what recording.json says."""
    manifest = json.loads((folder / "recording.json").read_text())
    (folder / "recording.json").write_text(json.dumps({**manifest, **entries}))


@pytest.mark.parametrize("rate_hz", [48_000, "44100", None])
def test_sound_of_another_rate_than_stated_is_refused(heard: Path, rate_hz: object) -> None:
    said(heard, audio={"rate_hz": rate_hz})
    with pytest.raises(InputError, match=r"audio has 44100 samples/s, recording\.json promises"):
        read_recording(heard)


PLAYED = {"kind": "chirp", "band_hz": [15_000, 20_000], "duration_s": 0.01, "period_s": 0.1}


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "tone"},
        {"band_hz": [16_000, 20_000]},
        {"band_hz": 15_000},
        {"duration_s": 0.02},
        {"period_s": 0.2},
        {"period_s": None},
    ],
)
def test_sound_of_another_excitation_is_refused(heard: Path, change: dict[str, object]) -> None:
    said(heard, chirp={**PLAYED, **change})
    with pytest.raises(InputError, match=rf"recording\.json: chirp\.{next(iter(change))} is"):
        read_recording(heard)


def test_the_excitation_stated_may_be_the_one_asked_for(heard: Path) -> None:
    said(heard, chirp=PLAYED)
    assert read_recording(heard).audio is not None
    said(heard, chirp={**PLAYED, "kind": "tone"})
    assert read_recording(heard, ChirpParameters(kind="tone")).audio is not None
    said(heard, chirp="loud")
    with pytest.raises(InputError, match="chirp is 'loud', wanted an object"):
        read_recording(heard)


def test_a_start_without_a_heading_leaves_it_to_the_compass(folder: Path, tmp_path: Path) -> None:
    (folder / "recording.json").write_text('{"format_version": 1, "start_pose": [1.5, -2]}')
    read = read_recording(folder)
    np.testing.assert_array_equal(read.start_pose, (1.5, -2.0, np.nan))
    write_recording(read, tmp_path / "again")
    np.testing.assert_array_equal(read_recording(tmp_path / "again").start_pose, read.start_pose)


def test_notes_make_a_round_trip(tmp_path: Path) -> None:
    notes = ("the clock was put back", "größer als sonst")
    write_recording(Recording("hall", "phone", notes=notes), tmp_path / "hall")
    assert read_recording(tmp_path / "hall").notes == notes


@pytest.mark.parametrize("notes", ["text", [1], ["x" * 501], ["x"] * 201])
def test_notes_that_are_none_are_refused(folder: Path, notes: object) -> None:
    said(folder, notes=notes)
    with pytest.raises(InputError, match=r"recording\.json: notes are"):
        read_recording(folder)


@pytest.mark.parametrize(("rate_hz", "kept_hz"), [(96_000, 48_000), (88_200, 44_100)])
def test_sound_at_multiples_of_rates_is_taken(tmp_path: Path, rate_hz: int, kept_hz: int) -> None:
    """What recording.json promises is of the file, before it is resampled."""
    write_recording(Recording("hall", "phone"), tmp_path / "hall")
    soundfile.write(tmp_path / "hall" / "audio.wav", np.zeros((rate_hz, 2)), rate_hz)
    said(tmp_path / "hall", audio={"rate_hz": rate_hz, "channels": 2, "samples": rate_hz})
    recording = read_recording(tmp_path / "hall")
    assert (recording.audio.samples.shape, recording.audio.rate_hz) == ((2, kept_hz), kept_hz)
    assert recording.notes == (f"the sound was resampled from {rate_hz} to {kept_hz} Hz",)
