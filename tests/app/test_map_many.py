"""Many recordings: each its run, by one or several, and nothing done twice."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from elfslam.app.map import MapJob
from elfslam.app.map_many import map_many
from elfslam.app.settings import Settings
from elfslam.app.workers.processes import Processes
from elfslam.base.enums import Modality
from elfslam.base.errors import StoreError
from elfslam.base.values import silent
from elfslam.data.recordings import write_recording
from elfslam.world.simulate import load_world, simulate

JOB = MapJob((Modality.MOTION,), None, "spectral", Settings(), overwrite=False)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "walk"
    write_recording(simulate(load_world("studio"), 111, rounds=1, sound=False)[0], folder)
    return folder


def test_of_many_each_gets_its_run_and_none_a_report(walk: Path, tmp_path: Path) -> None:
    refused = map_many(tmp_path, [walk, tmp_path / "none"], JOB, silent)
    assert list(refused) == ["none"]
    assert (tmp_path / "walk" / "run.json").is_file()
    assert not (tmp_path / "walk" / "report.html").exists()


def test_one_folder_that_is_taken_stops_many_before_the_first(walk: Path, tmp_path: Path) -> None:
    (tmp_path / "z").mkdir()
    (tmp_path / "z" / "thesis.txt").write_text("mine")
    with pytest.raises(StoreError, match="already exists"):
        map_many(tmp_path, [walk, walk.parent / "z"], JOB, silent)
    assert [item.name for item in tmp_path.iterdir()] == ["z"]


def test_what_is_done_is_not_done_again(walk: Path, tmp_path: Path) -> None:
    shares: list[float | None] = []
    map_many(tmp_path, [walk], JOB, silent)
    first = (tmp_path / "walk" / "run.json").stat()
    map_many(tmp_path, [walk], JOB, lambda _, share: shares.append(share))
    again = (tmp_path / "walk" / "run.json").stat()
    assert (first.st_ino, shares) == (again.st_ino, [1.0])
    with pytest.raises(StoreError, match="already exists"):
        map_many(tmp_path, [walk], replace(JOB, start_pose=(1.0, 0.0, 0.0)), silent)
    map_many(tmp_path, [walk], replace(JOB, start_pose=(1.0, 0.0, 0.0), overwrite=True), silent)
    assert (tmp_path / "walk" / "run.json").stat().st_ino != first.st_ino


@pytest.mark.real
def test_several_processes_make_the_same_runs(walk: Path, tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        shutil.copytree(walk, tmp_path / "in" / name)
    (tmp_path / "in" / "b" / "accelerometer.csv").write_text("t_s,x,y,z\n")
    paths = sorted((tmp_path / "in").iterdir())
    here = map_many(tmp_path / "here", paths, JOB, silent)
    there = map_many(tmp_path / "there", paths, JOB, silent, Processes(2))
    assert here == there
    assert list(there) == ["b"]
    for name in ("a", "c"):
        known, found = (tmp_path / who / name / "trajectory.tum" for who in ("here", "there"))
        assert known.read_bytes() == found.read_bytes()
