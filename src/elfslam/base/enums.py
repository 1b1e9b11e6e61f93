"""What users choose by name: modalities, ways to be located, formats."""

from collections.abc import Sequence
from enum import StrEnum

from elfslam.base.errors import ParameterError


class Mode(StrEnum):
    """How a phone is located: from sound alone, or with its footsteps too."""

    ONE_SHOT = "one-shot"
    TRAJECTORY = "trajectory"
    TRACK = "track"


LONGEST_S = 1e6
"""No recording is longer."""


class Modality(StrEnum):
    """What closes the loops."""

    ELF = "elf"
    WIFI = "wifi"
    MAGNETIC = "magnetic"
    EMR = "emr"
    MOTION = "motion"


class Format(StrEnum):
    """What a run or a map can become."""

    TUM = "tum"
    G2O = "g2o"
    ONNX = "onnx"
    GEOJSON = "geojson"
    IMDF = "imdf"
    ROS = "ros"
    PARQUET = "parquet"


def parse_modalities(text: str | None) -> tuple[Modality, ...]:
    """The modalities in "elf,magnetic", none where nothing is said. Raises ParameterError."""
    names = [] if text is None else [name.strip() for name in text.split(",")]
    known = [item.value for item in Modality]
    for name in names:
        if name not in known:
            raise ParameterError(f"--by: wanted {', '.join(known)}, got {name!r}; name one or some")
    modalities = tuple(Modality(name) for name in names)
    if refusal := refusal_of(modalities):
        raise ParameterError(f"--by: {refusal}")
    return modalities


def refusal_of(modalities: Sequence[Modality]) -> str:
    """Why these are not taken together, nothing where they are."""
    if len(set(modalities)) < len(modalities):
        return f"got {','.join(modalities)!r}; name each modality once"
    if Modality.MOTION in modalities and len(modalities) > 1:
        return "motion closes no loops; name it alone or leave it out"
    return ""


def parse_stretch(from_s: float | None, until_s: float | None) -> tuple[float, float] | None:
    """The stretch of a recording between two times, of which one may be open; None without both.

    Raises ParameterError where there is nothing between them.
    """
    if from_s is None and until_s is None:
        return None
    begin_s, end_s = from_s or 0.0, LONGEST_S if until_s is None else until_s
    if not 0 <= begin_s < end_s <= LONGEST_S:
        raise ParameterError(
            f"--from {begin_s:g} --until {end_s:g}: wanted seconds of the recording, the first "
            "before the second; change one"
        )
    return begin_s, end_s
