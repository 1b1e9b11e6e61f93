"""The door: the commands' work on values, the same figures, the same refusals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy.testing as npt
import plotly.graph_objects as go
import pytest

import elfslam
from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.base.errors import ElfslamError, InputError, ParameterError
from elfslam.base.values import Recording, Run, Truth, silent
from elfslam.data.recordings import write_recording
from elfslam.stages.feature import SpectralEncoder

Walk = tuple[Recording, Truth]
JOB = MapJob((), None, "spectral", Settings(), overwrite=False)


@pytest.fixture(scope="module")
def walk() -> Walk:
    return elfslam.simulate("studio", seed=100, rounds=2)


@pytest.fixture(scope="module")
def run(walk: Walk) -> Run:
    return elfslam.map(walk[0], encoder="spectral")


def test_mapping_a_value_is_mapping_its_file(walk: Walk, run: Run, tmp_path: Path) -> None:
    write_recording(walk[0], tmp_path / "walk")
    filed = map_into(tmp_path / "run", tmp_path / "walk", JOB, silent)
    again = elfslam.map(elfslam.read_recording(str(tmp_path / "walk")), encoder="spectral")
    npt.assert_array_equal(again.trajectory.world_from_body, filed.trajectory.world_from_body)
    npt.assert_array_equal(again.closures.i, filed.closures.i)


def test_an_encoder_of_ones_own_is_as_good_as_a_named_one(walk: Walk, run: Run) -> None:
    mine = elfslam.map(walk[0], encoder=SpectralEncoder())
    npt.assert_array_equal(mine.trajectory.world_from_body, run.trajectory.world_from_body)


def test_a_walk_is_located_in_its_own_map(walk: Walk, run: Run) -> None:
    recording, truth = walk
    fixes = elfslam.locate(recording, run)
    [ok, _] = elfslam.score(fixes, truth, mapped=run, map_truth=truth)
    assert isinstance(ok["median_m"], float)
    assert ok["median_m"] < 0.5


def test_scores_are_those_of_the_command(walk: Walk, run: Run) -> None:
    rows = elfslam.score(run, walk[1])
    assert {row["method"] for row in rows} == {"dead reckoning", "SLAM"}
    table = rows._repr_html_()
    assert table.count("<tr>") == len(rows) + 1
    assert "<th" in table
    assert "median_m" in table


def test_runs_of_one_name_are_told_apart_when_merged(run: Run) -> None:
    floor_map = elfslam.merge([run, run], known_starts=True)
    assert floor_map.sources == ("studio 1", "studio 2")


def test_settings_come_by_name_or_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("[closure]\nthreshold = 0.5\n")
    by_name = elfslam.settings_of({"closure.threshold": 0.5})
    assert by_name == elfslam.settings_of(tmp_path / "mine.toml")
    assert by_name == elfslam.settings_of(by_name)
    assert by_name.closure.threshold == 0.5
    assert elfslam.settings_of() == Settings()


def test_values_draw_themselves(walk: Walk, run: Run) -> None:
    assert run.floor_map is not None
    for drawn in (run.plot(), run.plot(walk[1]), run.floor_map.plot()):
        assert isinstance(drawn, go.Figure)
        assert len(drawn.data) > 1
    assert len(run.plot(walk[1]).data) > len(run.plot().data)


def test_values_say_what_they_are_in_a_line(walk: Walk, run: Run) -> None:
    assert repr(run).startswith("Run('studio', by elf:spectral-1: ")
    assert f"t_s: {len(run.trajectory.t_s)}, world_from_body: " in repr(run.trajectory)
    for value in (walk[0], run, run.trajectory, run.floor_map, run.features):
        assert "\n" not in repr(value)
        assert len(repr(value)) < 400


@pytest.mark.parametrize(
    ("asked", "kind", "said"),
    [
        (lambda walk, run: elfslam.map(walk[0], by="smell"), ParameterError, "'smell'"),
        (lambda walk, run: elfslam.map(walk[0], encoder="none.onnx"), InputError, "no such file"),
        (lambda walk, run: elfslam.map(walk[0], settings={"a.b": 1}), ParameterError, "'a.b'"),
        (
            lambda walk, run: elfslam.map(walk[0], by="wifi", encoder=SpectralEncoder()),
            ParameterError,
            "beside an encoder of your own",
        ),
        (
            lambda walk, run: elfslam.map(replace(walk[0], audio=None), by="elf"),
            InputError,
            "it has no sound",
        ),
        (lambda walk, run: elfslam.locate(walk[0], run, mode="far"), ParameterError, "one-shot"),
        (
            lambda walk, run: elfslam.locate(walk[0], replace(run, floor_map=None)),
            InputError,
            "mapped without sound",
        ),
        (
            lambda walk, run: elfslam.locate(walk[0], foreign(run)),
            InputError,
            "encoder mine-1; pass it",
        ),
        (lambda walk, run: elfslam.merge([run]), InputError, "wanted two runs or more"),
        (
            lambda walk, run: elfslam.score(elfslam.locate(walk[0], run), walk[1], mapped=run),
            InputError,
            "go together",
        ),
        (lambda walk, run: elfslam.plot(3), ParameterError, "got int"),
        (lambda walk, run: elfslam.simulate("nowhere"), InputError, "no such world"),
        (lambda walk, run: elfslam.simulate(kind="lazy"), ParameterError, "wanted people"),
        (lambda walk, run: elfslam.read_recording(Path("nowhere")), ElfslamError, "nowhere"),
    ],
)
def test_bad_input_is_refused_in_a_line(
    walk: Walk, run: Run, asked: Callable[[Walk, Run], object], kind: type[Exception], said: str
) -> None:
    with pytest.raises(kind, match=said) as refused:
        asked(walk, run)
    assert "\n" not in str(refused.value)


def foreign(run: Run) -> Run:
    """The run as if its map had been made with an encoder that is not shipped."""
    assert run.floor_map is not None
    payloads = tuple(replace(item, encoder="mine-1") for item in run.floor_map.payloads)
    return replace(run, floor_map=replace(run.floor_map, payloads=payloads))


def test_the_door_has_what_it_names() -> None:
    for name in elfslam.__all__:
        assert getattr(elfslam, name) is not None
    assert set(elfslam.__all__) == set(elfslam.HOME_OF)
    with pytest.raises(AttributeError, match="no attribute 'fly'"):
        elfslam.fly  # noqa: B018


def test_a_kind_of_walk_is_simulated_by_name() -> None:
    walk = {"rounds": 1, "sound": False}
    person, surveyor = (
        elfslam.simulate("studio", kind=kind, **walk)[0] for kind in ("people", "surveyor")
    )
    assert person.imu is not None
    assert surveyor.imu is not None
    assert len(person.imu.t_s) != len(surveyor.imu.t_s)
    other, _ = elfslam.simulate("studio", kind="people", asking=True, **walk)
    assert other.device != person.device
