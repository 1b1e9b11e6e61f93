"""Lobes of a transducer by the edges of the phone that it sits in."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from elfslam.base.arrays import F64, Value, array
from elfslam.base.errors import InputError


@dataclass(frozen=True, eq=False)
class Lobes(Value):
    """Lobes of a transducer, which the edges of the phone make: a pair of sources beside it.

    They stand `spacing_m` apart along `axis` (of the phone's axes, the transducer in the middle)
    and have `share` of the sound between them; all are in phase. Far away this is a gain of
    (1 - share) + share cos(pi spacing cos(angle to the axis) / wavelength). Raises InputError for
    a share beyond 0 to 1 or a negative spacing.
    """

    share: float = 0.0
    spacing_m: float = 0.0
    axis: F64 = field(
        default_factory=lambda: np.array([1.0, 0.0, 0.0]),
        metadata=array(3, unit_rows=True).metadata,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (0 <= self.share <= 1 and 0 <= self.spacing_m < np.inf):
            raise InputError(
                f"lobes: wanted a share from 0 to 1 and a spacing from 0, got {self.share} and "
                f"{self.spacing_m} m; correct them"
            )
