"""Footsteps near each other in a room: as near and as alike as it says."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.line.feature import load_encoder
from studies.offset_pairs import ACROSS_M, ALONG_M, pairs_in, together


@pytest.mark.real
def test_pairs_of_a_room_are_near_and_alike() -> None:
    pairs = pairs_in("studio", "people", load_encoder("compact"), 100)
    assert len(pairs.offset) > 50
    assert np.abs(pairs.offset[:, 0]).max() <= ALONG_M
    assert np.abs(pairs.offset[:, 1]).max() <= ACROSS_M
    assert pairs.likeness.min() > 0.1
    assert len(together([pairs, pairs]).offset) == 2 * len(pairs.offset)
