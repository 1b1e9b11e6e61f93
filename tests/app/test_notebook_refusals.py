"""Nonsense at the door: every argument of every function is refused in a line that names it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import elfslam
from elfslam.base.errors import ElfslamError
from elfslam.base.values import Audio, Imu

NONE, NUMBER, TEXT = None, 3, "nonsense"
ARRAY, LIST, PAIRS, NAN = np.zeros(3), [1, 2], {"a": 1}, float("nan")
ANYTHING = (NONE, NUMBER, TEXT, ARRAY, LIST, PAIRS, NAN, elfslam, elfslam.Recording)
"""None of these is a recording, a run, a map, fixes or a truth."""
NO_NUMBER = (NONE, TEXT, ARRAY, LIST, PAIRS, 1j)
NO_SEED = (*NO_NUMBER, -1, 0.5, 1e300, NAN, True, 2**64)
NO_TEXT = (NONE, NUMBER, ARRAY, LIST, PAIRS, b"compact")
NO_SETTINGS = (NUMBER, ARRAY, LIST, ["closure.threshold"], {3: 4})
NO_TIME = (TEXT, ARRAY, LIST, NAN, -1.0, 1e300, float("inf"), True)
NO_START = (
    *(NUMBER, TEXT, ARRAY, LIST, PAIRS, (), (1.0, 2.0), (1.0, 2.0, 0.0, 0.0)),
    *((NAN, 0.0, 0.0), (1e300, 0.0, 0.0), (0.0, float("inf"), 0.0), ("1", "2", "3")),
)
NO_SENSE = ((), [], NUMBER, [TEXT], [None], ARRAY, PAIRS, elfslam.Sense)
NO_FUNCTION = (NONE, NUMBER, TEXT)
NO_SWITCH = (NONE, NUMBER, TEXT, LIST)
NO_MODE = (*NO_TEXT, "far", "")
Made = SimpleNamespace


@pytest.fixture(scope="module")
def made() -> Made:
    """One good value of each kind."""
    recording, truth = elfslam.simulate("studio", seed=100, rounds=2)
    run = elfslam.map(recording, encoder="spectral")
    fixes = elfslam.locate(recording, run)
    return Made(recording=recording, truth=truth, run=run, fixes=fixes, floor_map=run.floor_map)


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


def cases() -> list[tuple[str, str, Any]]:
    return [
        (function, argument, value)
        for function, arguments in BAD.items()
        for argument, values in arguments.items()
        for value in values
    ]


def refusal(made: Made, function: str, argument: str, value: Any) -> str:
    """What is said to a good call with one bad argument."""
    given = GOOD[function](made) | {argument: value}
    with pytest.raises(ElfslamError) as refused:
        getattr(elfslam, function)(**given)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def kind_of(value: object) -> str:
    return re.sub(r"\W+", " ", repr(value))[:24].strip() or type(value).__name__


@pytest.mark.parametrize(("function", "argument", "value"), cases(), ids=kind_of)
def test_nonsense_is_refused_by_name(made: Made, function: str, argument: str, value: Any) -> None:
    said = refusal(made, function, argument, value)
    assert argument in said or str(value) in said
    assert "None" in said if value is None else True


@pytest.mark.parametrize(("function", "argument", "kind"), OF_A_KIND)
def test_a_good_value_in_the_wrong_place_is_refused_by_its_kind(
    made: Made, function: str, argument: str, kind: str
) -> None:
    value = getattr(made, kind)
    said = refusal(made, function, argument, value)
    assert f"{argument}: wanted" in said
    assert f"got {type(value).__name__}(" in said


def test_there_are_enough_of_them() -> None:
    assert len(cases()) > 150


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
        started = elfslam.map(recording, start=start, encoder="spectral", from_s=0, until_s=60)  # type: ignore[arg-type]
        assert started.trajectory.world_from_body[0, :2] == pytest.approx([1, 2], abs=1)
    elfslam.simulate("studio", np.int64(3), rounds=np.int32(1), sound=False, sensors=["wifi"])
    assert elfslam.load_encoder("spectral").identity == "spectral-1"
