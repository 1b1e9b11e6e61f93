"""The numbers that pages share with Python: `python -m tests.serve.pages.constants` writes them."""

import json
from dataclasses import asdict
from pathlib import Path
from types import ModuleType

from elfslam.base import values
from elfslam.data import baseband
from elfslam.stages import chirp, feature, medium_access, spoofing
from elfslam.stages.chirp import ChirpParameters
from elfslam.stages.echo import cut
from elfslam.stages.echo.sound import EchoParameters
from elfslam.stages.levels import LevelParameters
from elfslam.stages.medium_access import MediumAccessParameters
from elfslam.stages.motion import live, reckoning

FILE = Path(values.__file__).parents[1] / "serve" / "pages" / "stages" / "constants.js"
HEAD = """\
// Written by `python -m tests.serve.pages.constants`; edit the modules of elfslam.
// Parameters here are those of a phone that has no map; a map brings its own.
"""
FOREIGN = (
    "BIN", "GUARD", "DIRECT", "FRAME", "LULL", "QUIET", "WIDER", "NEAR_S", "FEWEST", "SAME",
    "LOUDEST_ECHO", "FADES",
)  # fmt: skip
"""Of what others chirp into a frame."""
LISTENING = ("SLACK", "LATE", "NOISE", "STRETCHES", "LOST", "REMEMBERED")
VOTE = ("vote_s", "least_lead")
FORMAT = ("rate_hz", "centre_hz", "frame_samples", "lead_s")


def constants() -> str:
    """The module of the pages."""
    return HEAD + "".join(f"\n{each}" for each in _exports())


def _exports() -> list[str]:
    alone = {
        "ACCEPTED_RATES_HZ": chirp.ACCEPTED_RATES_HZ,
        **_named(values, "ECHO_RATE_HZ", "ECHO_SAMPLES", "DISCARDED_SAMPLES", "ELF_SIZE"),
    }
    groups = {
        "CHIRP_PARAMETERS": asdict(ChirpParameters()),
        "ECHO_PARAMETERS": asdict(EchoParameters()),
        "MEDIUM_ACCESS": asdict(MediumAccessParameters()),
        "FOREIGN": _named(medium_access, *FOREIGN),
        "LISTENING": _named(
            medium_access, "SLACK", "LATE", "NOISE", "STRETCHES", "LOST", "REMEMBERED"
        ),
        "FACTS": _named(cut, "QUIET", "OVER", "FULL_SCALE"),
        "FLOOR_VOTE": {name: getattr(LevelParameters(), name) for name in VOTE},
        "BASEBAND_FORMAT": {name: getattr(baseband.BasebandFormat, name) for name in FORMAT},
        "BASEBAND_FILTER": _named(baseband, "KAISER_SHAPE", "HALF_SUPPORT_S", "LEAST"),
        "MEAN_NORMALISATION": _named(
            feature, "PRIOR_FRAMES", "STILL_ECHOES", "STILL", "STILL_WEIGHT"
        ),
        "ATTENUATION": _named(
            feature, "QUIET_PHONE_DB", "SUCCESSIVE", "LEAST_RELIABILITY", "NO_RELIABILITY"
        ),
        "SPOOFING": _named(spoofing, "PARTS", "SHARPENED", "RECENT", "HISS", "CALM"),
        "MOTION": {**_named(live, "REST_KEPT"), **_named(reckoning, "STEPS_AROUND")},
    }
    told = [f"export const {name} = {_said(value)};\n" for name, value in alone.items()]
    return ["".join(told)] + [
        f"export const {name} = {{\n"
        + "".join(f"  {key}: {_said(value)},\n" for key, value in group.items())
        + "};\n"
        for name, group in groups.items()
    ]


def _named(module: ModuleType, *names: str) -> dict[str, object]:
    return {name: getattr(module, name) for name in names}


def _said(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_said, value))}]"
    whole = isinstance(value, float) and value.is_integer()
    return json.dumps(int(value) if whole else value)  # type: ignore[call-overload]


if __name__ == "__main__":
    FILE.write_text(constants(), encoding="utf-8")
