"""Logs of Sensor Logger, as either platform writes them."""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
import soundfile

from elfslam.base.errors import InputError
from elfslam.base.geometry import rotation_from_quaternion
from elfslam.base.values import Recording
from elfslam.data.sensorlogger import read_sensorlogger

TILT = 0.4
T_S = np.arange(50) * 0.01
UP = np.array([0.0, np.sin(TILT), np.cos(TILT)])
"""Up in the axes of a phone whose top edge was raised by TILT."""
WORLD_FROM_PHONE = np.array([np.sin(TILT / 2), 0, 0, np.cos(TILT / 2)])


def table(values: np.ndarray, columns: str = "z,y,x", t_s: np.ndarray = T_S) -> str:
    """The app writes its columns backward, and a nanosecond clock in front."""
    rows = [
        f"{1718030736872695300 + int(t * 1e9)},{t:.4f}," + ",".join(f"{v:.9f}" for v in row[::-1])
        for t, row in zip(t_s, np.broadcast_to(values, (len(t_s), len(values))), strict=True)
    ]
    return "\n".join([f"time,seconds_elapsed,{columns}", *rows]) + "\n"


def metadata(platform: str, standardisation: str = "") -> str:
    return (
        "version,device name,recording epoch time,platform,standardisation\n"
        f"3,Test Phone,1718030736872,{platform},{standardisation}\n"
    )


ANDROID = {
    "Metadata.csv": metadata("android", "false"),
    "TotalAcceleration.csv": table(9.80665 * UP),
    "Accelerometer.csv": table(np.zeros(3)),
    "Gyroscope.csv": table(np.array([0.1, 0.2, 0.3])),
    "Magnetometer.csv": table(np.array([10.0, 20.0, -30.0])),
    "Orientation.csv": table(WORLD_FROM_PHONE, "qw,qz,qy,qx"),
}
IOS = {
    **{name: ANDROID[name] for name in ("Gyroscope.csv", "Magnetometer.csv")},
    "Metadata.csv": metadata("ios", "false"),
    "Accelerometer.csv": table(np.array([-0.5, 0.0, 0.0])),
    "Gravity.csv": table(-9.80665 * UP),
    "Orientation.csv": table(WORLD_FROM_PHONE * [-1, -1, -1, 1], "qw,qz,qy,qx"),
}


SENSOR_FILES = [name for name in ANDROID if name != "Metadata.csv"]


def log(folder: Path, files: dict[str, str | bytes]) -> Path:
    with zipfile.ZipFile(folder / "walk.zip", "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return folder / "walk.zip"


def recorded(folder: Path, files: dict[str, str | bytes]) -> Recording:
    """What is read of a log with these files."""
    return read_sensorlogger(log(folder, files)).recording


def test_android(tmp_path: Path) -> None:
    recording = recorded(tmp_path, ANDROID)
    assert (recording.name, recording.device) == ("walk", "Test Phone")
    npt.assert_allclose(recording.imu.t_s, T_S)
    npt.assert_allclose(recording.imu.accel_mps2[7], 9.80665 * UP, atol=1e-8)
    npt.assert_allclose(recording.imu.gyro_radps[7], [0.1, 0.2, 0.3])
    npt.assert_allclose(recording.magnetometer.field_ut[7], [10, 20, -30])


def test_ios_adds_gravity_and_flips_the_sign(tmp_path: Path) -> None:
    imu = recorded(tmp_path, IOS).imu
    npt.assert_allclose(imu.accel_mps2[7], 9.80665 * UP + [0.5, 0, 0], atol=1e-8)
    npt.assert_allclose(imu.gyro_radps[7], [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("standardisation", "gravity", "sign"),
    [("true", UP, 1), ("true", -UP, -1), ("false", -UP, 1), ("", -UP, 1), ("", UP, 1)],
)
def test_ios_standardised_or_not(
    tmp_path: Path, standardisation: str, gravity: np.ndarray, sign: int
) -> None:
    still = {"Gravity.csv": table(9.80665 * gravity), "Accelerometer.csv": table(np.zeros(3))}
    files = {**IOS, **still, "Metadata.csv": metadata("iOS", standardisation)}
    del files["Orientation.csv"]
    imu = recorded(tmp_path, files).imu
    npt.assert_allclose(imu.accel_mps2[0], sign * 9.80665 * UP, atol=1e-8)


def test_uncalibrated_ios_acceleration_is_in_g_and_flipped(tmp_path: Path) -> None:
    files = {name: IOS[name] for name in ("Metadata.csv", "Gyroscope.csv")}
    files["AccelerometerUncalibrated.csv"] = table(-UP)
    imu = recorded(tmp_path, files).imu
    npt.assert_allclose(imu.accel_mps2[0], 9.80665 * UP, atol=1e-7)


def test_rows_from_before_the_start_are_kept(tmp_path: Path) -> None:
    early = T_S - 0.1
    accel, gyro = table(9.80665 * UP, t_s=early), table(np.zeros(3), t_s=early)
    files = {"TotalAcceleration.csv": accel, "Gyroscope.csv": gyro}
    npt.assert_allclose(recorded(tmp_path, files).imu.t_s, early, atol=1e-4)


@pytest.mark.parametrize(
    ("rows", "unit_hpa"), [([0.5, 1013.25], 1.0), ([-0.5, 101.325], 10.0)], ids=["hPa", "kPa"]
)
def test_barometers_have_two_units(tmp_path: Path, rows: list[float], unit_hpa: float) -> None:
    written = table(np.array(rows), "pressure,relativeAltitude")
    barometer = recorded(tmp_path, {**ANDROID, "Barometer.csv": written}).barometer
    npt.assert_allclose(barometer.pressure_hpa, np.full(len(T_S), rows[1] * unit_hpa))
    npt.assert_allclose(barometer.t_s, T_S)


def test_a_barometer_that_says_nothing_of_the_air_is_left_out(tmp_path: Path) -> None:
    for written in (table(np.zeros(1), "pressure"), table(np.zeros(1), "relativeAltitude")):
        files = {**ANDROID, "Barometer.csv": written}
        assert recorded(tmp_path, files).barometer is None


def test_networks_are_read_whatever_their_names(tmp_path: Path) -> None:
    rows = "time,seconds_elapsed,ssid,bssid,frequency,level,capabilities\n" + "".join(
        f'1,{t_s},{name},{bssid},2412,{level},"[WPA2]"\n'
        for t_s, name, bssid, level in [
            (0.5, '"a, ""b"""', "aa", -50),
            (0.5, "home", "bb", -60),
            (1.5, "", "aa", -55),
        ]
    )
    wifi = recorded(tmp_path, {**ANDROID, "WiFi.csv": rows}).wifi
    assert wifi.bssids == ("aa", "bb")
    npt.assert_array_equal(wifi.rssi_dbm, [[-50, -60], [-55, np.nan]])
    for bad in (",x,", ",nan,", ",,"):
        damaged = rows.replace(",-60,", bad)
        with pytest.raises(InputError, match=r"WiFi\.csv: row 3 lacks a number"):
            read_sensorlogger(log(tmp_path, {**ANDROID, "WiFi.csv": damaged}))


@pytest.mark.parametrize("files", [ANDROID, IOS], ids=["android", "ios"])
def test_gravity_decides_how_the_quaternion_turns(tmp_path: Path, files: dict[str, str]) -> None:
    attitude = recorded(tmp_path, files).orientation.world_from_phone
    npt.assert_allclose(rotation_from_quaternion(attitude[0]) @ UP, [0, 0, 1], atol=1e-6)


def test_an_attitude_against_gravity_is_left_out(tmp_path: Path) -> None:
    sideways = table(np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]), "qw,qz,qy,qx")
    recording = recorded(tmp_path, {**ANDROID, "Orientation.csv": sideways})
    assert recording.orientation is None


@pytest.mark.parametrize(("rate_hz", "kept"), [(16_000, False), (44_100, True), (48_000, True)])
def test_only_sound_with_the_chirp_band_is_kept(tmp_path: Path, rate_hz: int, kept: bool) -> None:
    sound = io.BytesIO()
    soundfile.write(sound, np.zeros(1000), rate_hz, format="WAV")
    audio = recorded(tmp_path, {**ANDROID, "Microphone.wav": sound.getvalue()}).audio
    assert (audio is not None) == kept


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda row: [*row[:1], str(1000 * float(row[1])), *row[2:]], "do not overlap enough"),
        (lambda row: [*row[:4], "1e160"], r"walk\.zip/Gyroscope\.csv: row 2 has 1e\+160 rad/s"),
    ],
    ids=["milliseconds", "huge"],
)
def test_a_gyroscope_that_cannot_be_believed_is_refused(
    tmp_path: Path, change: Callable[[list[str]], list[str]], says: str
) -> None:
    head, *rows = ANDROID["Gyroscope.csv"].splitlines()
    lines = [head, *(",".join(change(row.split(","))) for row in rows)]
    with pytest.raises(InputError, match=says):
        read_sensorlogger(log(tmp_path, {**ANDROID, "Gyroscope.csv": "\n".join(lines)}))


def test_without_metadata_and_extras_it_still_reads(tmp_path: Path) -> None:
    files = {f"folder/{name}": ANDROID[name] for name in ("TotalAcceleration.csv", "Gyroscope.csv")}
    recording = recorded(tmp_path, files)
    assert recording.device == "unknown"
    assert recording.magnetometer is None


@pytest.mark.parametrize("absent", ["Gyroscope.csv", "Gravity.csv", "Accelerometer.csv"])
def test_missing_motion_sensors_are_refused(tmp_path: Path, absent: str) -> None:
    files = {name: content for name, content in IOS.items() if name != absent}
    what = "gravity is missing" if absent == "Gravity.csv" else "motion sensors are missing"
    with pytest.raises(InputError, match=rf"walk\.zip: {what}"):
        read_sensorlogger(log(tmp_path, files))


def test_damaged_logs_are_refused(tmp_path: Path) -> None:
    damaged = {**ANDROID, "Gyroscope.csv": "time,seconds_elapsed,z,y,x\n0,0,1,1,1\n1,1,x,1,1\n"}
    file = log(tmp_path, damaged)
    with pytest.raises(InputError, match=r"walk\.zip/Gyroscope\.csv: row 3 has 'x'"):
        read_sensorlogger(file)
    file = log(tmp_path, ANDROID)
    file.write_bytes(file.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"is not whole"):
        read_sensorlogger(file)
    with pytest.raises(InputError, match=r"is no file"):
        read_sensorlogger(tmp_path / "none.zip")


def saved_again(text: str, separator: str, point: str, *, quoted: bool = False) -> str:
    """As a spreadsheet saves it: another separator and decimal mark, and its own line ends."""
    rows = [[cell.replace(".", point) for cell in line.split(",")] for line in text.splitlines()]
    mark = '"' if quoted else ""
    lines = (separator.join(f"{mark}{cell}{mark}" for cell in row) for row in rows)
    return "\ufeff" + "".join(f"{line}\r\n" for line in lines)


@pytest.mark.parametrize(
    ("separator", "point", "quoted"),
    [(";", ",", False), ("\t", ",", False), ("\t", ".", False), (";", ".", True), (",", ",", True)],
)
def test_what_a_spreadsheet_saved_again_reads_the_same(
    tmp_path: Path, separator: str, point: str, quoted: bool
) -> None:
    wifi = "time,seconds_elapsed,ssid,bssid,frequency,level\n1,0.25,home,aa,2412,-50.5\n"
    whole = {**ANDROID, "WiFi.csv": wifi}
    again = {log: saved_again(text, separator, point, quoted=quoted) for log, text in whole.items()}
    wanted = recorded(tmp_path, whole)
    found = recorded(tmp_path, again)
    assert found.device == wanted.device
    npt.assert_array_equal(found.imu.accel_mps2, wanted.imu.accel_mps2)
    npt.assert_array_equal(found.imu.t_s, wanted.imu.t_s)
    npt.assert_array_equal(found.magnetometer.field_ut, wanted.magnetometer.field_ut)
    npt.assert_array_equal(found.wifi.rssi_dbm, wanted.wifi.rssi_dbm)
    npt.assert_array_equal(found.wifi.t_s, wanted.wifi.t_s)


def test_decimal_commas_between_commas_are_refused_and_not_guessed(tmp_path: Path) -> None:
    bad = saved_again(ANDROID["Gyroscope.csv"], ",", ",")
    with pytest.raises(InputError, match=r"row 2 has 9 cells for 5 columns"):
        read_sensorlogger(log(tmp_path, {**ANDROID, "Gyroscope.csv": bad}))


def annotations(*taps: tuple[float, str]) -> str:
    rows = [f'{1718030736872695300 + int(t * 1e9)},{t},"{text}",80\n' for t, text in taps]
    return "time,seconds_elapsed,text,millisecond_press_duration\n" + "".join(rows)


def test_taps_with_a_text_are_checkpoints(tmp_path: Path) -> None:
    taps = annotations((0.1, "door"), (0.3, " the  window "), (0.2, ""), (0.3, "again"))
    recording = recorded(tmp_path, {**ANDROID, "Annotation.csv": taps})
    assert recording.checkpoints.names == ("door", "the window")
    npt.assert_array_equal(recording.checkpoints.t_s, [0.1, 0.3])
    assert recording.checkpoints.xy_m is None
    assert [note[:39] for note in recording.notes] == ["annotations that are no checkpoints: 2;"]


@pytest.mark.parametrize(
    "texts", [("1.5, -2.0", "door", "12;0"), ("+1,5 ;-2", "door", " 12 ; 0,0")]
)
def test_two_numbers_are_a_place_on_the_plan(tmp_path: Path, texts: tuple[str, ...]) -> None:
    taps = annotations(*zip((0.1, 0.2, 0.3), texts, strict=True))
    recording = recorded(tmp_path, {**ANDROID, "Annotation.csv": taps})
    places = [[1.5, -2], [np.nan, np.nan], [12, 0]]
    npt.assert_array_equal(recording.checkpoints.xy_m, places)
    assert recording.notes == ("annotations taken as places on a plan, x and y in metres: 2",)


def test_annotations_that_say_nothing_are_none(tmp_path: Path) -> None:
    for taps in ([], [(0.1, "")]):
        files = {**ANDROID, "Annotation.csv": annotations(*taps)}
        recording = recorded(tmp_path, files)
        assert recording.checkpoints is None
        assert len(recording.notes) == len(taps)
    bad = log(tmp_path, {**ANDROID, "Annotation.csv": annotations((0.1, "a")).replace("0.1", "x")})
    with pytest.raises(InputError, match=r"Annotation\.csv: .* is no time"):
        read_sensorlogger(bad)


def put_back(text: str, back_s: float, *, whole: bool) -> str:
    """From half of the rows on the app's seconds are less; `whole`: the phone's clock too."""
    head, *lines = text.splitlines()
    rows = [line.split(",") for line in lines]
    for row in rows[len(rows) // 2 :]:
        row[1] = f"{float(row[1]) - back_s:.4f}"
        row[0] = str(int(row[0]) - round(back_s * 1e9) * whole)
    return "\n".join([head, *map(",".join, rows)]) + "\n"


def test_where_the_phones_own_clock_ran_on_that_one_is_taken(tmp_path: Path) -> None:
    """A restart of the app's seconds is then as long as it was, and nothing is to be told."""
    taps = annotations((0.1, "door"), (0.4, "window")).replace(",0.4,", ",0.1,")
    jumped = {name: put_back(ANDROID[name], 0.25, whole=False) for name in SENSOR_FILES}
    recording = recorded(tmp_path, {**ANDROID, **jumped, "Annotation.csv": taps})
    npt.assert_allclose(recording.imu.t_s, T_S, atol=1e-4)
    npt.assert_allclose(recording.checkpoints.t_s, [0.1, 0.4], atol=1e-3)
    assert recording.notes == ()
