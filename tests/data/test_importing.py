"""Every format is known by its content, whatever the file is called, and never as another."""

import io
import tarfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from planted_logs import LOGS, T_S

from elfslam.base.errors import InputError
from elfslam.base.values import Imu, Recording
from elfslam.data.importing import LogFormat, Refused, read_logs, recognise, takes_many
from elfslam.data.log_files import Imported
from elfslam.data.recordings import read_recording, write_recording

MALL = "".join(
    f"{1574559495255 + 20 * k}\tTYPE_{kind}\t0.1\t0.2\t9.8\t3\n"
    for k in range(80)
    for kind in ("ACCELEROMETER", "GYROSCOPE")
)
GETSENSORDATA = LOGS[LogFormat.GETSENSORDATA]()["walk.txt"]


def mat_bytes(**arrays: object) -> bytes:
    content = io.BytesIO()
    scipy.io.savemat(content, arrays, do_compression=True)
    return content.getvalue()


def magnetic() -> bytes:
    rows = len(T_S)
    return mat_bytes(
        t=T_S[:, None],
        tm=T_S[:, None],
        quat=np.tile([0.5**0.5, 0.5**0.5, 0, 0], (rows, 1)),
        m=np.tile([-40.0, 0.0, -20.0], (rows, 1)),
        dPos=np.tile([0.0, 0.1, 0.0], (rows - 1, 1)),
    )


def zipped(path: Path, files: Mapping[str, str | bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def tarred(path: Path, files: Mapping[str, str]) -> Path:
    with tarfile.open(path, "w:xz") as archive:
        for name, text in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(text.encode())
            archive.addfile(entry, io.BytesIO(text.encode()))
    return path


def under(folder: str, files: Mapping[str, str]) -> dict[str, str]:
    return {f"{folder}/{name}": text for name, text in files.items()}


PACKED = [LogFormat.SENSORLOGGER, LogFormat.PHYPHOX, LogFormat.RONIN]


@pytest.mark.parametrize("log_format", PACKED)
@pytest.mark.parametrize("folder", ["", "walk/"])
def test_a_zip_is_known_by_its_content(tmp_path: Path, log_format: LogFormat, folder: str) -> None:
    files = {f"{folder}{name}": text for name, text in LOGS[log_format]().items()}
    clutter = {"__MACOSX/walk/._Gyroscope.csv": "seconds_elapsed", f"{folder}.DS_Store": "x"}
    path = zipped(tmp_path / "anything.mat", {**files, **clutter, f"{folder}README.txt": "hello"})
    assert recognise(path) is log_format
    (item,) = read_logs(log_format, path, np.random.default_rng(0))
    assert item.recording.name == "anything"


@pytest.mark.parametrize("log_format", PACKED)
def test_a_folder_is_known_and_read_as_its_zip_is(tmp_path: Path, log_format: LogFormat) -> None:
    for name, text in LOGS[log_format]().items():
        file = tmp_path / "walk.1" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    assert recognise(tmp_path / "walk.1") is log_format
    (item,) = read_logs(log_format, tmp_path / "walk.1", np.random.default_rng(0))
    assert item.recording.name == "walk.1"


@pytest.mark.parametrize("name", ["walk.zip", "walk"])
@pytest.mark.parametrize(
    ("content", "log_format"),
    [
        (MALL.encode(), LogFormat.MALL),
        (b"#\tstartTime:1574559495255\r\n" + MALL.encode(), LogFormat.MALL),
        (GETSENSORDATA.encode(), LogFormat.GETSENSORDATA),
        (b"\xef\xbb\xbf% a comment\r\n" + GETSENSORDATA.encode(), LogFormat.GETSENSORDATA),
        (GETSENSORDATA.replace("0.1;0.2", "0,1;0,2").encode(), LogFormat.GETSENSORDATA),
        (magnetic(), LogFormat.MAGNETIC),
    ],
)
def test_a_single_file_is_known_whatever_it_is_called(
    tmp_path: Path, name: str, content: bytes, log_format: LogFormat
) -> None:
    (tmp_path / name).write_bytes(content)
    assert recognise(tmp_path / name) is log_format
    assert not takes_many(log_format, tmp_path / name) or log_format is LogFormat.MALL


def test_an_archive_of_walks_is_known(tmp_path: Path) -> None:
    path = tarred(tmp_path / "site", {"site/one.txt": MALL, "site/two.txt": MALL})
    assert recognise(path) is LogFormat.MALL
    names = [item.recording.name for item in imported(LogFormat.MALL, path)]
    assert names == ["one", "two"]


def imported(log_format: LogFormat, path: Path) -> list[Imported]:
    items = list(read_logs(log_format, path, np.random.default_rng(0)))
    return [item for item in items if isinstance(item, Imported)]


@pytest.mark.parametrize(
    ("ending", "content", "log_format"),
    [
        ("txt", MALL, LogFormat.MALL),
        ("txt", GETSENSORDATA, LogFormat.GETSENSORDATA),
        ("mat", magnetic(), LogFormat.MAGNETIC),
    ],
)
def test_many_walks_in_one_zip_are_many_recordings(
    tmp_path: Path, ending: str, content: str | bytes, log_format: LogFormat
) -> None:
    names = ["two", "one", "a/three"]
    path = zipped(tmp_path / "walks.zip", {f"{name}.{ending}": content for name in names})
    assert recognise(path) is log_format
    assert takes_many(log_format, path)
    assert [item.recording.name for item in imported(log_format, path)] == ["three", "one", "two"]


def test_one_bad_walk_in_a_zip_is_told_by_its_own_name(tmp_path: Path) -> None:
    path = zipped(tmp_path / "walks.zip", {"good.txt": MALL, "bad.txt": "1\tTYPE_X\t1\n"})
    items = list(read_logs(LogFormat.MALL, path, np.random.default_rng(0)))
    (refused,) = [item for item in items if isinstance(item, Refused)]
    assert (refused.name, len(items)) == ("bad.txt", 2)
    assert refused.reason.startswith("bad.txt: has no TYPE_ACCELEROMETER records")


def test_a_recording_of_our_own_is_none_of_them(tmp_path: Path) -> None:
    walk = Recording("walk", "phone", imu=Imu(T_S, *np.tile([[[0, 0, 9.8]], [[0, 0, 0]]], (80, 1))))
    write_recording(walk, tmp_path / "walk")
    assert recognise(tmp_path / "walk") is None
    files = {each.name: each.read_bytes() for each in (tmp_path / "walk").iterdir()}
    assert recognise(zipped(tmp_path / "top.zip", files)) is None
    inside = {f"walk/{name}": content for name, content in files.items()}
    assert recognise(zipped(tmp_path / "inside.zip", inside)) is None


SENSORLOGGER, PHYPHOX = LOGS[LogFormat.SENSORLOGGER](), LOGS[LogFormat.PHYPHOX]()
RONIN = LOGS[LogFormat.RONIN]()


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({**SENSORLOGGER, **under("b", PHYPHOX)}, "holds a recording of Sensor Logger"),
        ({**RONIN, "walk.txt": MALL}, "wanted one of them; give each alone"),
        ({"a.txt": MALL, "b.txt": GETSENSORDATA}, "wanted one of them"),
        ({"a.txt": MALL + GETSENSORDATA}, "wanted one of them"),
        ({"recording.json": "{}", **SENSORLOGGER}, "a recording of elfslam (recording.json)"),
        ({"xl/workbook.xml": "<x/>", "[Content_Types].xml": ""}, "is an Excel file"),
        ({"one.zip": b"PK\x03\x04", "two.zip": b"PK\x03\x04"}, "holds other .zip files"),
        ({"a.csv": "t_s,x,y,z\n0,1,2,3\n"}, "holds a.csv, which are of no known log"),
        ({"Accelerometer.csv": "time,x,y,z\n0,1,2,3\n"}, "of no known log"),
        ({"deep/down/recording.jso": "{}"}, "of no known log"),
        ({}, "holds no file"),
        ({"__MACOSX/a.csv": "seconds_elapsed\n"}, "holds no file"),
    ],
)
def test_a_zip_of_none_or_of_several_is_refused_in_one_line(
    tmp_path: Path, files: dict[str, str | bytes], words: str
) -> None:
    refuse(zipped(tmp_path / "walk.zip", files), words)


def refuse(path: Path, words: str) -> None:
    with pytest.raises(InputError) as refused:
        recognise(path)
    said = str(refused.value)
    assert said.startswith(str(path))
    assert words in said
    assert "\n" not in said


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"%PDF-1.7 x", "is a PDF"),
        (b"\x89HDF\r\n\x1a\n", "is an HDF5 file"),
        (b"MATLAB 7.3 MAT-file, Platform", "-v7"),
        (b"7z\xbc\xaf\x27\x1c", "pack it as .zip"),
        (b'[{"sensor": "Accelerometer"}]', "is JSON"),
        (b"seconds_elapsed,z,y,x\n1,2,3,4\n", "is one file of a recording of Sensor Logger"),
        (b'"Time (s)","X (m/s^2)"\n1,2\n', "is one file of an export of phyphox"),
        (b"t_s,x,y,z\n0,1,2,3\n", "begins with 't_s,x,y,z'"),
        (b"\x00" * 500, "which no known log does"),
        (mat_bytes(x=np.zeros(3)), "is a .mat file without m, quat, dPos, t, tm"),
        (magnetic()[:300], "a .mat file"),
        (b"PK\x03\x04" + bytes(100), "the .zip is not whole"),
        (b"\xfd7zXZ\x00" + bytes(100), "is a broken archive"),
    ],
)
def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "walk.zip").write_bytes(content)
    refuse(tmp_path / "walk.zip", words)


def test_a_lone_file_of_ronin_says_what_it_belongs_to(tmp_path: Path) -> None:
    (tmp_path / "acce.txt").write_text(RONIN["acce.txt"])
    refuse(tmp_path / "acce.txt", "is one file of a log of RoNIN")


def test_what_is_not_there_is_refused(tmp_path: Path) -> None:
    refuse(tmp_path / "none.zip", "does not exist")
    (tmp_path / "folder").mkdir()
    refuse(tmp_path / "folder", "holds no file")


@pytest.mark.parametrize("log_format", PACKED)
def test_two_recordings_in_one_zip_are_refused_whoever_named_the_format(
    tmp_path: Path, log_format: LogFormat
) -> None:
    files = LOGS[log_format]()
    path = zipped(tmp_path / "walk.zip", {**under("a", files), **under("b", files)})
    assert recognise(path) is log_format
    with pytest.raises(InputError, match=r"holds several recordings .a/"):
        imported(log_format, path)


@pytest.mark.parametrize("log_format", LOGS)
def test_half_a_log_is_known_as_it_is_or_not_at_all(tmp_path: Path, log_format: LogFormat) -> None:
    """Whatever subset of the files is there: never another format's name."""
    files = LOGS[log_format]()
    for left_out in files:
        rest = {k: v for k, v in files.items() if k != left_out}
        for kept in ({left_out: files[left_out]}, rest):
            path = zipped(tmp_path / "walk.zip", kept)
            assert known(path) in (log_format, "of no known log", "holds no file")


def known(path: Path) -> str:
    """The format, or which of two refusals was said."""
    try:
        return str(recognise(path))
    except InputError as refused:
        said = str(refused)
        return next(each for each in ("of no known log", "holds no file") if each in said)


def savetxt(text: str) -> str:
    """As numpy writes it unasked."""
    rows = [line for line in text.splitlines() if not line.startswith("#")]
    content = io.StringIO()
    np.savetxt(content, np.array([row.split() for row in rows], dtype=float))
    return content.getvalue()


def spreadsheet(text: str) -> str:
    return text.replace(",", ";").replace(".", ",")


WAYS: dict[str, tuple[LogFormat, Mapping[str, str]]] = {
    "numpy.savetxt": (
        LogFormat.RONIN,
        {name: savetxt(text) for name, text in RONIN.items() if name.endswith(".txt")},
    ),
    "names of columns": (
        LogFormat.RONIN,
        {name: "t x y z\n" + text for name, text in RONIN.items() if ".txt" in name},
    ),
    "from zero": (LogFormat.RONIN, {name: text for name, text in RONIN.items() if ".txt" in name}),
    "capitals": (LogFormat.RONIN, {name.upper(): text for name, text in RONIN.items()}),
    "small letters": (
        LogFormat.SENSORLOGGER,
        {name.lower(): text for name, text in SENSORLOGGER.items()},
    ),
    "decimal commas": (
        LogFormat.SENSORLOGGER,
        {name: spreadsheet(text) for name, text in SENSORLOGGER.items() if name != "WiFi.csv"},
    ),
    "deep": (LogFormat.PHYPHOX, under("a/b", PHYPHOX)),
    "ending in capitals": (
        LogFormat.PHYPHOX,
        {name.replace(".csv", ".CSV"): text for name, text in PHYPHOX.items()},
    ),
    "decimal commas of phyphox": (
        LogFormat.PHYPHOX,
        {
            name: spreadsheet(text)
            for name, text in PHYPHOX.items()
            if "," in text and not name.startswith("meta")
        },
    ),
    "spaces": (LogFormat.GETSENSORDATA, {"a.txt": GETSENSORDATA.replace(";", " ; ")}),
    "indented": (LogFormat.GETSENSORDATA, {"a.txt": GETSENSORDATA.replace("\n", "\n  ")}),
    "old Mac": (LogFormat.GETSENSORDATA, {"a.txt": GETSENSORDATA.replace("\n", "\r")}),
    "no header": (LogFormat.MALL, {"a.txt": MALL}),
}


@pytest.mark.parametrize("way", WAYS)
def test_what_a_reader_takes_is_recognised_however_written(tmp_path: Path, way: str) -> None:
    log_format, files = WAYS[way]
    path = zipped(tmp_path / "walk.zip", files)
    assert recognise(path) is log_format
    (item,) = imported(log_format, path)
    np.testing.assert_allclose(item.recording.imu.t_s, T_S, atol=1e-5)


def test_what_no_reader_takes_is_not_recognised(tmp_path: Path) -> None:
    """Seconds in place of nanoseconds, cells that commas part."""
    for change in (lambda text: text.replace("0000000 ", " "), lambda text: text.replace(" ", ",")):
        files = {name: change(text) for name, text in RONIN.items()}
        refuse(zipped(tmp_path / "walk.zip", files), "of no known log")


@pytest.mark.parametrize("log_format", LOGS)
def test_a_whole_log_becomes_a_recording_on_disk(tmp_path: Path, log_format: LogFormat) -> None:
    (item,) = imported(log_format, zipped(tmp_path / "walk.zip", LOGS[log_format]()))
    write_recording(item.recording, tmp_path / "walk", truth=item.truth)
    again = read_recording(tmp_path / "walk")
    np.testing.assert_allclose(again.imu.t_s, T_S, atol=2e-6)
    np.testing.assert_allclose(again.imu.accel_mps2, item.recording.imu.accel_mps2, atol=1e-6)
    assert (again.audio is not None) == (log_format is LogFormat.PHYPHOX)
    has_truth = (tmp_path / "walk" / "waypoints.csv").is_file()
    assert has_truth == (log_format is LogFormat.GETSENSORDATA)
    assert item.damaged_lines == 0
