"""Indoor positioning from the sound of a phone (ELF-SLAM and beyond).

The names below are imported when they are first used; see `elfslam.app.api`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elfslam.app.api import finetune, locate, map, merge, plot, score, settings_of, simulate
    from elfslam.app.way import find_way
    from elfslam.base.errors import (
        ElfslamError,
        InputError,
        NoAnswerError,
        ParameterError,
        StoreError,
    )
    from elfslam.base.values import (
        Audio,
        Closures,
        Echoes,
        Features,
        Fixes,
        FixStatus,
        FloorMap,
        Imu,
        Odometry,
        Recording,
        Run,
        Trajectory,
        Truth,
    )
    from elfslam.data.recordings import read_recording
    from elfslam.slam.pipeline import Sense
    from elfslam.stages.feature import Encoder, load_encoder

__version__ = "0.1.0"
HOMES = {
    "app.api": (
        "finetune", "locate", "map", "merge", "plot", "score", "settings_of", "simulate",
    ),
    "app.way": ("find_way",),
    "base.errors": (
        "ElfslamError", "InputError", "NoAnswerError", "ParameterError", "StoreError",
    ),
    "base.values": (
        "Audio", "Closures", "Echoes", "Features", "FixStatus", "Fixes", "FloorMap", "Imu",
        "Odometry", "Recording", "Run", "Trajectory", "Truth",
    ),
    "data.recordings": ("read_recording",),
    "stages.feature": ("Encoder", "load_encoder"),
    "slam.pipeline": ("Sense",),
}  # fmt: skip
"""Where each public name stands."""
HOME_OF = {name: f"elfslam.{home}" for home, names in HOMES.items() for name in names}
__all__ = [
    "Audio",
    "Closures",
    "Echoes",
    "ElfslamError",
    "Encoder",
    "Features",
    "FixStatus",
    "Fixes",
    "FloorMap",
    "Imu",
    "InputError",
    "NoAnswerError",
    "Odometry",
    "ParameterError",
    "Recording",
    "Run",
    "Sense",
    "StoreError",
    "Trajectory",
    "Truth",
    "find_way",
    "finetune",
    "load_encoder",
    "locate",
    "map",
    "merge",
    "plot",
    "read_recording",
    "score",
    "settings_of",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """A public name, imported with its room on first use."""
    if name not in HOME_OF:
        raise AttributeError(f"module 'elfslam' has no attribute {name!r}")
    return getattr(import_module(HOME_OF[name]), name)


def __dir__() -> list[str]:
    """What completion offers."""
    return [*__all__, "__version__"]
