"""Echo cutting: find the direct arrival of every chirp and cut the echo trace behind it.

Chirps come once per period, or when a schedule says that they were played; the direct arrival is
then looked for where it is due. `frame_facts` tells what else was heard around each of them.
"""

from elfslam.stages.echo.arrivals import (
    Arrivals,
    Frames,
    best_channel,
    find_arrivals,
    find_frames,
    find_scheduled,
)
from elfslam.stages.echo.cut import cut_echoes, echoes_of, frame_facts
from elfslam.stages.echo.sound import (
    EchoParameters,
    check_audio,
    matched_envelope,
    resampled,
    to_echo_rate,
)

__all__ = [
    "Arrivals",
    "EchoParameters",
    "Frames",
    "best_channel",
    "check_audio",
    "cut_echoes",
    "echoes_of",
    "find_arrivals",
    "find_frames",
    "find_scheduled",
    "frame_facts",
    "matched_envelope",
    "resampled",
    "to_echo_rate",
]
