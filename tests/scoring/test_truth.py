"""Truth files: what they give, and what is refused with one line."""

import tracemalloc
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Truth
from elfslam.scoring.truth import read_truth

TUM_ROW = "0.5 1 2 0 0 0 0.7071068 0.7071068\n"


def tum_text(truth: Truth) -> str:
    rows = ["# t x y z qx qy qz qw"]
    for t, (x, y, heading) in zip(truth.t_s, truth.world_from_body, strict=True):
        z, w = np.sin(heading / 2), np.cos(heading / 2)
        rows.append(f"{t:.9f} {x:.9f} {y:.9f} 0 0 0 {z:.12f} {w:.12f}")
    return "\n".join(rows) + "\n"


def test_tum_round_trip(tmp_path: Path, truth: Truth) -> None:
    (tmp_path / "truth.tum").write_text(tum_text(truth))
    back = read_truth(tmp_path / "truth.tum")
    assert np.allclose(back.t_s, truth.t_s)
    assert np.allclose(back.world_from_body[:, :2], truth.world_from_body[:, :2])
    turned = back.world_from_body[:, 2] - truth.world_from_body[:, 2]
    assert np.allclose(np.cos(turned), 1)


def test_waypoints_have_no_heading(tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("\ufefft_s,x_m,y_m\r\n0, 1.5, 2\r\n4,3,2\r\n", encoding="utf-8")
    truth = read_truth(path)
    assert truth.t_s.tolist() == [0, 4]
    assert truth.world_from_body[:, :2].tolist() == [[1.5, 2], [3, 2]]
    assert np.isnan(truth.world_from_body[:, 2]).all()


def test_a_recording_prefers_full_poses(tmp_path: Path) -> None:
    (tmp_path / "waypoints.csv").write_text("t_s,x_m,y_m\n0,0,0\n")
    assert np.isnan(read_truth(tmp_path).world_from_body[0, 2])
    (tmp_path / "truth.tum").write_text(TUM_ROW)
    assert np.allclose(read_truth(tmp_path).world_from_body, [[1, 2, np.pi / 2]])


@pytest.mark.parametrize("inside", ["truth.tum", "walk/truth.tum"])
def test_a_zip_with_or_without_its_folder(tmp_path: Path, inside: str) -> None:
    path = tmp_path / "walk.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("recording.json", "{}")
        archive.writestr(inside, TUM_ROW)
    assert np.allclose(read_truth(path).world_from_body, [[1, 2, np.pi / 2]])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("truth.tum", "0 1 2 3\n", "line 1: wanted 8 numbers"),
        ("truth.tum", TUM_ROW + "1 a 2 0 0 0 0 1\n", "line 2: wanted 8 numbers"),
        ("truth.tum", "0 nan 2 0 0 0 0 1\n", "line 1: wanted 8 numbers"),
        ("truth.tum", "0 1 2 0 0 0 0 0\n", "line 1: quaternion"),
        ("truth.tum", "1 1 2 0 0 0 0 1\n0 1 2 0 0 0 0 1\n", "runs backward"),
        ("truth.tum", "# nothing\n", "no rows"),
        ("truth.tum", "1 1 2 0 0 0 0 1\n1 1 2 0 0 0 0 1\n", "repeats"),
        ("waypoints.csv", "x,y\n1,2\n", "wanted the header t_s,x_m,y_m"),
        ("waypoints.csv", "", "wanted the header t_s,x_m,y_m, got nothing"),
        ("waypoints.csv", "t_s,x_m,y_m\n1,2\n", "line 2: wanted 3 numbers"),
        ("waypoints.csv", "t_s,x_m,y_m\n", "no rows"),
    ],
)
def test_malformed_files_are_refused(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as refusal:
        read_truth(tmp_path / name)
    assert name in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_missing_and_truthless_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_truth(tmp_path / "absent.tum")
    with pytest.raises(InputError, match="no truth in this recording"):
        read_truth(tmp_path)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("recording.json", "{}")
    with pytest.raises(InputError, match="no truth in this recording"):
        read_truth(tmp_path / "a.zip")


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(b"not a zip")
    with pytest.raises(InputError, match="is not whole"):
        read_truth(tmp_path / "a.zip")
    (tmp_path / "truth.tum").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(InputError, match="is no text in UTF-8"):
        read_truth(tmp_path / "truth.tum")


@pytest.mark.parametrize("line", ["1\n", ",\n", "{k},1,2\n"])
def test_a_large_file_takes_a_few_times_its_own_size(tmp_path: Path, line: str) -> None:
    rows = "".join(line.format(k=k) for k in range(50_000))
    (tmp_path / "waypoints.csv").write_text("t_s,x_m,y_m\n" + rows)
    tracemalloc.start()
    try:
        with suppress(InputError):
            read_truth(tmp_path / "waypoints.csv")
        assert tracemalloc.get_traced_memory()[1] < 20 * len(rows)
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("number", ["1e308", "-1e16", "nan", "9" * 400])
def test_numbers_beyond_belief_are_refused(tmp_path: Path, number: str) -> None:
    (tmp_path / "waypoints.csv").write_text(f"t_s,x_m,y_m\n0,1,2\n1,{number},2\n")
    with pytest.raises(InputError, match="line 3: wanted 3 numbers"):
        read_truth(tmp_path / "waypoints.csv")
