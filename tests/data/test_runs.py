"""Runs on disk."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elfslam.base import values
from elfslam.base.errors import InputError, StoreError
from elfslam.data.map_files import read_facts
from elfslam.data.recordings import write_recording
from elfslam.data.runs import digest_of, read_run, write_run
from elfslam.data.truth_files import write_truth

FACTS = {"parameters": {"closure": {"threshold": 0.4}}, "digest": "abc"}


@pytest.fixture
def folder(tmp_path: Path, run: values.Run) -> Path:
    write_run(run, tmp_path / "run", facts=FACTS, encoder=b"weights")
    return tmp_path / "run"


def test_round_trip(folder: Path, run: values.Run) -> None:
    read = read_run(folder)
    assert (read.name, read.seconds) == ("hall", run.seconds)
    close = {"rtol": 1e-8, "atol": 4e-9}
    for value in ("odometry", "trajectory", "closures", "features"):
        for name, wanted in vars(getattr(run, value)).items():
            got = getattr(getattr(read, value), name)
            if wanted is None or isinstance(wanted, str):
                assert got == wanted
            else:
                np.testing.assert_allclose(got, wanted, err_msg=f"{value}.{name}", **close)
    np.testing.assert_allclose(read.similarity.scores, run.similarity.scores, atol=5e-4)
    assert read.similarity.kind == "elf"
    np.testing.assert_array_equal(read.floor_map.xy_m, run.floor_map.xy_m)


def test_checkpoints_lie_beside_the_run(tmp_path: Path, run: values.Run) -> None:
    told = values.Checkpoints(np.array([0.5, 1.0]), ("Door", "Desk"), np.array([[1, 2], [3.5, 4]]))
    write_run(replace(run, checkpoints=told), tmp_path / "run", facts=FACTS, encoder=None)
    read = read_run(tmp_path / "run").checkpoints
    assert read.names == told.names
    np.testing.assert_array_equal(read.xy_m, told.xy_m)


def test_echoes_lose_66_db_at_most(folder: Path, run: values.Run) -> None:
    samples = read_run(folder).echoes.samples
    noise = np.square(samples - run.echoes.samples).mean() / np.square(run.echoes.samples).mean()
    assert 0 < noise < 10**-6.6


def test_a_run_without_the_optional_parts_round_trips(tmp_path: Path, run: values.Run) -> None:
    none = values.Closures([], [], [], np.empty((0, 3)), np.empty((0, 3, 3)))
    trajectory = replace(run.trajectory, closure_weights=[], status="NO_CLOSURES")
    bare = replace(
        run, closures=none, trajectory=trajectory, floor_map=None, echoes=None, features=None
    )
    write_run(bare, tmp_path / "run", facts={}, encoder=None)
    read = read_run(tmp_path / "run")
    assert (read.floor_map, read.echoes, read.features) == (None, None, None)
    assert len(read.closures.i) == 0
    assert read.trajectory.status == "NO_CLOSURES"


def test_a_run_of_an_earlier_version_is_read(folder: Path, run: values.Run) -> None:
    """Its echoes have a level over the noise besides."""
    arrays = dict(np.load(folder / "echoes.npz"))
    np.savez_compressed(folder / "echoes.npz", **arrays, snr_db=np.full(30, 20.0))
    read = read_run(folder).echoes
    np.testing.assert_array_equal(read.t_s, run.echoes.t_s)


def test_other_programs_find_their_files(folder: Path) -> None:
    assert {"map.npz", "report.html"} - {file.name for file in folder.iterdir()} == {"report.html"}
    header, first, _ = (folder / "closures.csv").read_text().splitlines()
    assert header.startswith("i,j,t_i_s,t_j_s,score,weight")
    assert first.startswith("0,4,0.000000,2.000000,0.5,1,")
    assert (folder / "encoder.onnx").read_bytes() == b"weights"
    assert json.loads((folder / "timings.json").read_text()) == {"echo": 0.5, "graph": 0.25}
    assert read_facts(folder) == {"name": "hall", **FACTS}


def test_a_run_is_replaced_only_when_asked(folder: Path, run: values.Run) -> None:
    with pytest.raises(StoreError, match="already exists; choose another folder"):
        write_run(run, folder, facts={}, encoder=None)
    assert read_facts(folder)["digest"] == "abc"
    write_run(run, folder, facts={"digest": "new"}, encoder=None, replace=True)
    assert read_facts(folder)["digest"] == "new"
    assert not (folder / "encoder.onnx").exists()
    assert sorted(path.name for path in folder.parent.iterdir()) == ["run"]


FILES = (
    "run.json",
    "timings.json",
    "uncertainty.npz",
    "similarity.npz",
    "echoes.npz",
    "features.npz",
    "map.npz",
    "trajectory.tum",
    "odometry.tum",
    "closures.csv",
)


@pytest.mark.parametrize("name", FILES)
def test_every_cut_off_file_is_refused(folder: Path, name: str) -> None:
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(content[: len(content) - 25])
    with pytest.raises(StoreError, match=name.replace(".", r"\.")) as refused:
        read_run(folder)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["trajectory_covariance", "closure_covariance"])
@pytest.mark.parametrize(
    ("cell", "why"), [((1, 0, 1), "not symmetric"), ((1, 2, 2), "not positive")]
)
def test_a_covariance_that_is_none_is_named_with_its_row(
    folder: Path, name: str, cell: tuple[int, int, int], why: str
) -> None:
    with np.load(folder / "uncertainty.npz") as stored:
        arrays = dict(stored)
    arrays[name][cell] = -5.0
    np.savez(folder / "uncertainty.npz", **arrays)
    with pytest.raises(StoreError, match=rf"covariance: row 1 is no covariance, as it is {why}"):
        read_run(folder)


def test_files_of_different_runs_are_refused(folder: Path) -> None:
    rows = (folder / "trajectory.tum").read_text().splitlines(keepends=True)
    (folder / "trajectory.tum").write_text("".join(rows[:-1]))
    with pytest.raises(StoreError, match="is no whole run"):
        read_run(folder)


def test_digest_follows_names_and_contents(tmp_path: Path) -> None:
    def digest(name: str, content: str) -> str:
        folder = tmp_path / f"{name}-{content}"
        folder.mkdir()
        (folder / name).write_text(content)
        return digest_of(folder)

    first = digest("a", "x")
    assert len(first) == 64
    assert first == digest_of(tmp_path / "a-x")
    assert len({first, digest("b", "x"), digest("a", "y")}) == 3
    with pytest.raises(InputError, match="does not exist"):
        digest_of(tmp_path / "none")


def test_closures_of_footsteps_that_are_not_there_are_refused(folder: Path) -> None:
    file = folder / "closures.csv"
    header, first, *rest = file.read_text().splitlines()
    cells = first.split(",")
    file.write_text("\n".join([header, ",".join([cells[0], "9999", *cells[2:]]), *rest]) + "\n")
    with pytest.raises(StoreError, match="names more than"):
        read_run(folder)


def test_the_digest_of_a_recording_knows_nothing_of_its_truth(
    tmp_path: Path, recording: values.Recording, truth: values.Truth
) -> None:
    folder = tmp_path / "hall"
    write_recording(recording, folder)
    blind = digest_of(folder)
    zipped = Path(shutil.make_archive(str(tmp_path.parent / "blind"), "zip", tmp_path))
    assert digest_of(zipped) == blind
    write_truth(truth, folder)
    (folder / "waypoints.csv").write_text("t_s,x_m,y_m\n0,0,0\n")
    assert digest_of(folder) == blind
    assert digest_of(Path(shutil.make_archive(str(tmp_path / "seen"), "zip", folder))) == blind
    (folder / "wifi.csv").unlink()
    assert digest_of(folder) != blind
