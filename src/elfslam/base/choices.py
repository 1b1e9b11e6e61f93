"""What users choose by name: senses, ways to be located, formats."""

from __future__ import annotations

from enum import StrEnum

from elfslam.base.errors import ParameterError


class Mode(StrEnum):
    """How a phone is located: from sound alone, or with its footsteps too."""

    ONE_SHOT = "one-shot"
    TRAJECTORY = "trajectory"
    TRACK = "track"


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
    if len(set(names)) < len(names):
        raise ParameterError(f"--by: got {text!r}; name each modality once")
    if Modality.MOTION in names and len(names) > 1:
        raise ParameterError("--by: motion closes no loops; name it alone or leave it out")
    return tuple(Modality(name) for name in names)
