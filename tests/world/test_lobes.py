"""Lobes: what cannot be is refused; their law is tested where they are heard (test_pulses.py)."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.world.transducers import Lobes


@pytest.mark.parametrize(("share", "spacing_m"), [(-0.1, 0.05), (1.1, 0.05), (0.3, -0.01)])
def test_lobes_that_cannot_be_are_refused(share: float, spacing_m: float) -> None:
    with pytest.raises(InputError, match="lobes: wanted a share from 0 to 1 and a spacing from 0"):
        Lobes(share, spacing_m)


def test_an_axis_is_a_direction() -> None:
    with pytest.raises(InputError, match=r"Lobes\.axis: wanted rows of length 1"):
        Lobes(0.2, 0.05, np.array([1.0, 1.0, 0.0]))
    assert Lobes().share == 0.0
