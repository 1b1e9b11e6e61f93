"""A recording becomes a run on disk: with its report or not at all."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.app import map
from elfslam.app.settings import Settings
from elfslam.app.workers.processes import Processes
from elfslam.base.enums import Modality
from elfslam.base.errors import InputError, NoAnswerError, StoreError
from elfslam.base.parameters import load
from elfslam.base.values import Audio, Imu, Recording, silent
from elfslam.data.baseband import frame_starts_s, to_baseband
from elfslam.data.recordings import write_recording
from elfslam.scoring import report
from elfslam.stages.chirp import make_chirp
from elfslam.world.circumstances import Circumstances
from elfslam.world.simulate import load_world, simulate

JOB = map.MapJob((Modality.MOTION,), None, "spectral", Settings(), overwrite=False)
AGAIN = map.MapJob((Modality.MOTION,), None, "spectral", Settings(), overwrite=True)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "walk"
    write_recording(simulate(load_world("studio"), 111, rounds=1, sound=False)[0], folder)
    return folder


def fail(*arguments: object, **named: object) -> None:
    raise RuntimeError("planted")


def test_a_run_never_lies_there_without_its_report(
    walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(report, "write_report", fail)
        with pytest.raises(RuntimeError, match="planted"):
            map.map_into(tmp_path / "run", walk, JOB, silent)
    assert list(tmp_path.iterdir()) == []
    run = map.map_into(tmp_path / "run", walk, JOB, silent)
    assert run.similarity.kind == "motion"
    assert (tmp_path / "run" / "report.html").is_file()
    assert [item.name for item in tmp_path.iterdir()] == ["run"]


def test_a_replacement_that_fails_keeps_the_older_run(
    walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    map.map_into(tmp_path / "run", walk, JOB, silent)
    (tmp_path / "run" / "score.html").write_text("of the older run")
    monkeypatch.setattr(report, "write_report", fail)
    with pytest.raises(RuntimeError, match="planted"):
        map.map_into(tmp_path / "run", walk, AGAIN, silent)
    assert (tmp_path / "run" / "score.html").exists()
    monkeypatch.undo()
    map.map_into(tmp_path / "run", walk, AGAIN, silent)
    assert not (tmp_path / "run" / "score.html").exists()
    with pytest.raises(StoreError, match="already exists"):
        map.map_into(tmp_path / "run", walk, JOB, silent)


def test_fine_tuning_without_echoes_is_refused(walk: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fine-tuning learns echoes; leave it out by motion"):
        map.map_into(tmp_path / "run", walk, replace(JOB, finetune=True), silent)
    assert list(tmp_path.iterdir()) == []


def test_a_unit_is_the_recording_and_what_is_asked_for(walk: Path, tmp_path: Path) -> None:
    known = map.unit_of(walk, JOB)
    assert map.unit_of(walk, AGAIN) == known, "whether an older run may go makes no other run"
    assert map.unit_of(walk, replace(JOB, encoder="compact")) != known
    assert map.unit_of(walk, replace(JOB, start_pose=(1.0, 2.0, 0.0))) != known
    assert map.unit_of(walk, replace(JOB, kept_s=(2.0, 9.0))) != known
    other = load(Settings(), None, ["closure.threshold=0.5"])
    assert map.unit_of(walk, replace(JOB, parameters=other)) != known
    write_recording(simulate(load_world("studio"), 112, rounds=1)[0], tmp_path / "walk")
    assert map.unit_of(tmp_path / "walk", JOB) != known


HEARD = map.MapJob((), None, "spectral", Settings(), overwrite=False)
HOLE_S = (12.0, 15.0)


@pytest.fixture(scope="module")
def heard() -> Recording:
    """Two rounds, with sound."""
    return simulate(load_world("studio"), 107, rounds=2, rate_hz=48_000)[0]


def ended_early(recording: Recording) -> Recording:
    """The page was loaded anew: the last 0.8 s of the motion were not written yet."""
    return moved(recording, lambda t_s: t_s < t_s[-1] - 0.8)


def asleep(recording: Recording) -> Recording:
    """No motion for three seconds."""
    return moved(recording, lambda t_s: (t_s < HOLE_S[0]) | (t_s > HOLE_S[1]))


def moved(recording: Recording, kept: Callable[[np.ndarray], np.ndarray]) -> Recording:
    imu = recording.imu
    rows = kept(imu.t_s)
    return replace(recording, imu=Imu(imu.t_s[rows], imu.accel_mps2[rows], imu.gyro_radps[rows]))


def called(recording: Recording) -> Recording:
    """No sound for three seconds."""
    samples = recording.audio.samples.copy()
    first, last = (round(each * 48_000) for each in HOLE_S)
    samples[:, first:last] = 0.0
    return replace(recording, audio=Audio(samples, 48_000))


def as_phones_keep_it(recording: Recording, folder: Path) -> Path:
    """In frames of the chirp band; where there is no sound there is no frame."""
    audio = recording.audio
    starts_s = frame_starts_s(audio, make_chirp(Settings().chirp, 48_000))
    write_recording(recording, folder, baseband=to_baseband(audio, starts_s))
    return folder


@pytest.mark.parametrize(
    ("broken", "lacks"),
    [
        (lambda recording: recording, []),
        (ended_early, ["motion"]),
        (asleep, ["motion", "sound"]),
        (called, ["sound"]),
    ],
    ids=["whole", "motion ends early", "motion with a hole", "sound with a hole"],
)
def test_what_a_phone_could_record_is_mapped_and_the_rest_said(
    heard: Recording, tmp_path: Path, broken: Callable[[Recording], Recording], lacks: list[str]
) -> None:
    walk = as_phones_keep_it(broken(heard), tmp_path / "walk")
    run = map.map_into(tmp_path / "run", walk, HEARD, silent)
    told = json.loads((tmp_path / "run" / "run.json").read_text())
    missing = told.get("missing", [])
    assert sorted(each["what"] for each in missing) == lacks
    assert len(run.trajectory.t_s) > 40
    assert len(run.floor_map.order) > 200
    report_text = (tmp_path / "run" / "report.html").read_text()
    assert ("<th>missing</th>" in report_text) == bool(lacks)
    if lacks and broken is not ended_early:
        for each in missing:
            assert (each["from_s"], each["until_s"]) == pytest.approx(HOLE_S, abs=0.2)
    elif lacks:
        assert missing[0]["until_s"] - missing[0]["from_s"] == pytest.approx(0.8, abs=0.2)


def test_a_phone_that_cannot_map_is_named_as_the_cause(tmp_path: Path) -> None:
    today = Circumstances(device="iphone 5c down")
    walk, _ = simulate(load_world("studio"), 111, rounds=1, circumstances=today)
    write_recording(walk, tmp_path / "walk")
    run = map.map_into(tmp_path / "run", tmp_path / "walk", HEARD, silent)
    (note,) = json.loads((tmp_path / "run" / "run.json").read_text())["notes"]
    assert "under the noise of a chirp" in note
    with pytest.raises(NoAnswerError, match="under the noise of a chirp"):
        map.refuse_unclosed(run)


def test_spots_lie_where_the_whole_walk_has_them(heard: Recording) -> None:
    """Up to the hole nothing differs; over it there is no spot, and behind it the walk goes on."""
    whole, holed = (map.map_recording(each, HEARD).run for each in (heard, asleep(heard)))
    before = whole.odometry.t_s < HOLE_S[0] - 2
    both = [each.odometry.world_from_body for each in (holed, whole)]
    npt.assert_allclose(both[0][: before.sum()], both[1][before], atol=0.2)
    assert not ((holed.echoes.t_s > HOLE_S[0]) & (holed.echoes.t_s < HOLE_S[1])).any()
    assert (holed.echoes.t_s > HOLE_S[1]).sum() > 100


def test_a_stretch_is_mapped_alone(heard: Recording, tmp_path: Path) -> None:
    walk = as_phones_keep_it(heard, tmp_path / "walk")
    job = replace(HEARD, kept_s=(8.0, 25.0))
    run = map.map_into(tmp_path / "run", walk, job, silent)
    assert 8 <= run.odometry.t_s[0] < run.odometry.t_s[-1] <= 25
    told = json.loads((tmp_path / "run" / "run.json").read_text())
    assert told["kept_s"] == [8.0, 25.0]
    assert "missing" not in told
    with pytest.raises(InputError, match="wanted motion from 800 to 900 s"):
        map.map_into(tmp_path / "none", walk, replace(HEARD, kept_s=(800.0, 900.0)), silent)
    assert not (tmp_path / "none").exists()


def test_of_many_each_gets_its_run_and_none_a_report(walk: Path, tmp_path: Path) -> None:
    refused = map.map_many(tmp_path, [walk, tmp_path / "none"], JOB, silent)
    assert list(refused) == ["none"]
    assert (tmp_path / "walk" / "run.json").is_file()
    assert not (tmp_path / "walk" / "report.html").exists()


def test_a_taken_folder_stops_many_before_the_first(walk: Path, tmp_path: Path) -> None:
    (tmp_path / "z").mkdir()
    (tmp_path / "z" / "thesis.txt").write_text("mine")
    with pytest.raises(StoreError, match="already exists"):
        map.map_many(tmp_path, [walk, walk.parent / "z"], JOB, silent)
    assert [item.name for item in tmp_path.iterdir()] == ["z"]


def test_what_is_done_is_not_done_again(walk: Path, tmp_path: Path) -> None:
    shares: list[float | None] = []
    map.map_many(tmp_path, [walk], JOB, silent)
    first = (tmp_path / "walk" / "run.json").stat()
    map.map_many(tmp_path, [walk], JOB, lambda _, share: shares.append(share))
    again = (tmp_path / "walk" / "run.json").stat()
    assert (first.st_ino, shares) == (again.st_ino, [1.0])
    with pytest.raises(StoreError, match="already exists"):
        map.map_many(tmp_path, [walk], replace(JOB, start_pose=(1.0, 0.0, 0.0)), silent)
    map.map_many(tmp_path, [walk], replace(JOB, start_pose=(1.0, 0.0, 0.0), overwrite=True), silent)
    assert (tmp_path / "walk" / "run.json").stat().st_ino != first.st_ino


@pytest.mark.real
def test_several_processes_make_the_same_runs(walk: Path, tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        shutil.copytree(walk, tmp_path / "in" / name)
    (tmp_path / "in" / "b" / "accelerometer.csv").write_text("t_s,x,y,z\n")
    paths = sorted((tmp_path / "in").iterdir())
    here = map.map_many(tmp_path / "here", paths, JOB, silent)
    there = map.map_many(tmp_path / "there", paths, JOB, silent, Processes(2))
    assert here == there
    assert list(there) == ["b"]
    for name in ("a", "c"):
        known, found = (tmp_path / who / name / "trajectory.tum" for who in ("here", "there"))
        assert known.read_bytes() == found.read_bytes()
