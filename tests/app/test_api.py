"""The door: the commands' work on values, the same figures, the same refusals."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.testing as npt
import plotly.graph_objects as go
import pytest

import elfslam
from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.base.errors import ElfslamError, InputError, ParameterError
from elfslam.base.values import Audio, Imu, Recording, Run, Truth, silent
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
    both = (elfslam.simulate("studio", kind=kind, **walk)[0] for kind in ("people", "surveyor"))
    person, surveyor = both
    assert len(person.imu.t_s) != len(surveyor.imu.t_s)
    other, _ = elfslam.simulate("studio", kind="people", asking=True, **walk)
    assert other.device != person.device


NONE, NUMBER, TEXT, NAN = None, 3, "nonsense", float("nan")
ANYTHING = (NONE, NUMBER, TEXT, elfslam.Recording)
"""None of these is a recording, a run, a map, fixes or a truth."""
NO_NUMBER = (NONE, TEXT)
NO_SEED = (*NO_NUMBER, -1, 0.5, NAN, True, 2**64)
NO_TEXT = (NONE, NUMBER, b"compact")
NO_SETTINGS = (NUMBER, ["closure.threshold"], {3: 4})
NO_TIME = (TEXT, NAN, -1.0, 1e300, True)
NO_START = (NUMBER, (1.0, 2.0), (NAN, 0.0, 0.0), (1e300, 0.0, 0.0), ("1", "2", "3"))
NO_SENSE = ([], NUMBER, [TEXT], elfslam.Sense)
NO_FUNCTION = (NONE, TEXT)
NO_SWITCH = (NONE, NUMBER)
NO_MODE = (NONE, "far")
Made = SimpleNamespace


@pytest.fixture(scope="module")
def made(walk: Walk, run: Run) -> Made:
    """One good value of each kind."""
    fixes = elfslam.locate(walk[0], run)
    return Made(recording=walk[0], truth=walk[1], run=run, fixes=fixes, floor_map=run.floor_map)


GOOD: dict[str, Callable[[Made], dict[str, Any]]] = {
    "simulate": lambda made: {"world": "studio", "sound": False, "rounds": 1},
    "read_recording": lambda made: {},
    "load_encoder": lambda made: {},
    "map": lambda made: {"recording": made.recording, "encoder": "spectral"},
    "finetune": lambda made: {"recording": made.recording},
    "merge": lambda made: {"runs": [made.run, made.run], "known_starts": True},
    "locate": lambda made: {"recording": made.recording, "floor_map": made.run},
    "score": lambda made: {"estimate": made.run, "truth": made.truth},
    "plot": lambda made: {"value": made.fixes},
    "settings_of": lambda made: {},
}
"""A good call of each function, of which one argument is then made bad."""
BAD: dict[str, dict[str, tuple[Any, ...]]] = {
    "simulate": {
        "world": (*NO_TEXT, TEXT), "seed": NO_SEED, "kind": (*NO_TEXT, TEXT), "asking": NO_SWITCH,
        "rounds": (*NO_NUMBER, 0, -1, 1.5), "rate_hz": (*NO_NUMBER, 44_100.5),
        "sensors": (*NO_TEXT, TEXT, [TEXT]), "walker": (*NO_TEXT, TEXT), "nonsense": (1,),
        "circumstances": (NUMBER, TEXT),
    },
    "read_recording": {"path": (*NO_TEXT, TEXT)},
    "load_encoder": {"name": (*NO_TEXT, TEXT)},
    "map": {
        "recording": ANYTHING, "by": (*NO_SENSE, TEXT), "start": NO_START, "from_s": NO_TIME,
        "encoder": (*NO_TEXT, TEXT, elfslam.Recording), "until_s": NO_TIME,
        "settings": NO_SETTINGS, "announce": NO_FUNCTION,
    },
    "finetune": {
        "recording": ANYTHING, "encoder": (*NO_TEXT, TEXT), "seed": NO_SEED,
        "settings": NO_SETTINGS, "announce": NO_FUNCTION,
    },
    "merge": {
        "runs": (*ANYTHING, [], [None, None]), "known_starts": NO_SWITCH,
        "settings": NO_SETTINGS, "announce": NO_FUNCTION,
    },
    "locate": {
        "recording": ANYTHING, "floor_map": ANYTHING, "mode": NO_MODE,
        "encoder": (*NO_TEXT[1:], TEXT), "seed": NO_SEED, "phone_walk": ANYTHING[1:],
        "settings": NO_SETTINGS,
    },
    "score": {
        "estimate": ANYTHING, "truth": ANYTHING, "mapped": ANYTHING[1:],
        "map_truth": ANYTHING[1:],
    },
    "plot": {"value": ANYTHING, "truth": ANYTHING[1:], "floor_map": ANYTHING[1:]},
    "settings_of": {"given": NO_SETTINGS},
}  # fmt: skip
OF_A_KIND: tuple[tuple[str, str, str], ...] = (
    ("map", "recording", "floor_map"), ("map", "recording", "truth"), ("map", "encoder", "run"),
    ("finetune", "recording", "run"), ("merge", "runs", "run"), ("merge", "runs", "recording"),
    ("locate", "recording", "truth"), ("locate", "floor_map", "recording"),
    ("locate", "phone_walk", "run"), ("score", "estimate", "floor_map"),
    ("score", "truth", "run"), ("score", "mapped", "floor_map"), ("score", "map_truth", "fixes"),
    ("plot", "value", "recording"), ("plot", "truth", "recording"), ("plot", "floor_map", "run"),
)  # fmt: skip
"""Good values in the wrong place."""


def refusal(made: Made, function: str, argument: str, value: Any) -> str:
    """What is said to a good call with one bad argument."""
    given = GOOD[function](made) | {argument: value}
    with pytest.raises(ElfslamError) as refused:
        getattr(elfslam, function)(**given)
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize("function", BAD)
def test_nonsense_is_refused_by_name(made: Made, function: str) -> None:
    for argument, values in BAD[function].items():
        for value in values:
            said = refusal(made, function, argument, value)
            assert argument in said or str(value) in said
            assert "None" in said if value is None else True


def test_a_good_value_in_the_wrong_place_is_refused_by_its_kind(made: Made) -> None:
    for function, argument, kind in OF_A_KIND:
        value = getattr(made, kind)
        said = refusal(made, function, argument, value)
        assert f"{argument}: wanted" in said
        assert f"got {type(value).__name__}(" in said


def test_an_empty_truth_scores_nothing(made: Made) -> None:
    empty = elfslam.Truth(np.empty(0), np.empty((0, 3)))
    assert "truth: wanted Truth of one row or more" in refusal(made, "score", "truth", empty)


def test_sound_without_channels_is_no_sound() -> None:
    with pytest.raises(elfslam.InputError, match=r"Audio\.samples: wanted .*, got \(0, 100\)"):
        Audio(np.zeros((0, 100), dtype=np.float32), 44_100)


def test_motion_without_rows_is_no_motion(made: Made) -> None:
    nothing = Imu(np.empty(0), np.empty((0, 3)), np.empty((0, 3)))
    still = replace(made.recording, imu=nothing)
    for function in ("map", "finetune", "locate"):
        assert "\n" not in refusal(made, function, "recording", still)
    assert "wanted rows of motion, got none" in refusal(made, "locate", "recording", still)


def test_what_was_good_is_good(made: Made, tmp_path: Path) -> None:
    recording = made.recording
    for start in ((1, 2, 0), [1.0, 2.0, 0.0], (np.float32(1), np.int64(2), 0.5)):
        started = elfslam.map(recording, start=start, encoder="spectral", from_s=0, until_s=60)
        assert started.trajectory.world_from_body[0, :2] == pytest.approx([1, 2], abs=1)
    elfslam.simulate("studio", np.int64(3), rounds=np.int32(1), sound=False, sensors=["wifi"])
    assert elfslam.load_encoder("spectral").identity == "spectral-1"
