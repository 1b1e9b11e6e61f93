"""A recording becomes a run on disk: with its report or not at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from elfslam.app.map import MapJob, map_into, unit_of
from elfslam.app.settings import Settings
from elfslam.base.choices import Modality
from elfslam.base.errors import InputError, StoreError
from elfslam.base.parameters import load
from elfslam.base.progress import silent
from elfslam.data.recordings import write_recording
from elfslam.scoring import report
from elfslam.world.simulate import load_world, simulate

JOB = MapJob((Modality.MOTION,), None, "spectral", Settings(), overwrite=False)
AGAIN = MapJob((Modality.MOTION,), None, "spectral", Settings(), overwrite=True)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "walk"
    write_recording(simulate(load_world("studio"), 111, rounds=1)[0], folder)
    return folder


def fail(*arguments: object, **named: object) -> None:
    raise RuntimeError("planted")


def test_a_run_never_lies_there_without_its_report(
    walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(report, "write_report", fail)
        with pytest.raises(RuntimeError, match="planted"):
            map_into(tmp_path / "run", walk, JOB, silent)
    assert list(tmp_path.iterdir()) == []
    run = map_into(tmp_path / "run", walk, JOB, silent)
    assert run.similarity.kind == "motion"
    assert (tmp_path / "run" / "report.html").is_file()
    assert [item.name for item in tmp_path.iterdir()] == ["run"]


def test_a_replacement_that_fails_keeps_the_older_run(
    walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    map_into(tmp_path / "run", walk, JOB, silent)
    (tmp_path / "run" / "score.html").write_text("of the older run")
    monkeypatch.setattr(report, "write_report", fail)
    with pytest.raises(RuntimeError, match="planted"):
        map_into(tmp_path / "run", walk, AGAIN, silent)
    assert (tmp_path / "run" / "score.html").exists()
    monkeypatch.undo()
    map_into(tmp_path / "run", walk, AGAIN, silent)
    assert not (tmp_path / "run" / "score.html").exists()
    with pytest.raises(StoreError, match="already exists"):
        map_into(tmp_path / "run", walk, JOB, silent)


def test_fine_tuning_without_echoes_is_refused(walk: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--finetune learns echoes; leave it out with --by motion"):
        map_into(tmp_path / "run", walk, replace(JOB, finetune=True), silent)
    assert list(tmp_path.iterdir()) == []


def test_a_unit_is_the_recording_and_what_is_asked_for(walk: Path, tmp_path: Path) -> None:
    known = unit_of(walk, JOB)
    assert unit_of(walk, AGAIN) == known, "whether an older run may go makes no other run"
    assert unit_of(walk, replace(JOB, encoder="compact")) != known
    assert unit_of(walk, replace(JOB, start_pose=(1.0, 2.0, 0.0))) != known
    other = load(Settings(), None, ["closure.threshold=0.5"])
    assert unit_of(walk, replace(JOB, parameters=other)) != known
    write_recording(simulate(load_world("studio"), 112, rounds=1)[0], tmp_path / "walk")
    assert unit_of(tmp_path / "walk", JOB) != known
