"""Files of other programs as their users have them: each kind read, or refused with its cause.

`python -m pytest -s tests/data/test_foreign_walks.py` prints a row a case: what it is, what was
wanted and what came.
"""

from pathlib import Path

import numpy as np
import pytest

from elfslam.data.recordings import read_recording, write_recording
from tests.data.foreign_walk import ACCEL_MPS2, CASES, T_S, packed, told


def compare(case: str, wanted: str, got: str) -> None:
    print(f"\n{case:<34} | {wanted:<55} | {got}", end="")
    assert got == wanted


@pytest.mark.parametrize("case", CASES)
def test_a_walk_is_read_whole_whatever_was_done_to_it(tmp_path: Path, case: str) -> None:
    made, wanted = CASES[case]
    got, item = told(packed(made(), tmp_path / "walk.zip"))
    compare(case, wanted, got)
    if item is None:
        return
    imu, gap_s = item.recording.imu, 3600 * (T_S >= 8) * (case == "clock put forward")
    np.testing.assert_allclose(imu.t_s, T_S + gap_s, atol=1e-5)
    np.testing.assert_allclose(imu.accel_mps2, ACCEL_MPS2, atol=1e-5)
    write_recording(item.recording, tmp_path / "walk")
    again = read_recording(tmp_path / "walk")
    assert again.notes == item.recording.notes
    if (taps := item.recording.checkpoints) is not None:
        assert again.checkpoints.names == taps.names == ("door", "1.5, 2", "door")
        np.testing.assert_array_equal(again.checkpoints.xy_m[1], [1.5, 2.0])
