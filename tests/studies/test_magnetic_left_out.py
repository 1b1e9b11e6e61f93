"""Magnetic closures chosen by leaving sets out: who chooses, and that the left out set does not."""

from pathlib import Path

from studies.magnetic_left_out import (
    CHOICE_SEEDS,
    LEFT_OUT,
    DriftedWalk,
    Errors,
    best_choice,
    measure_magnetic_left_out,
)
from studies.magnetic_walks import RECKONED, RMSE
from studies.study import StudyContext

BOLD, SHY = (0.45, 0.5, 0.35), (0.65, 3.0, 0.25)
NOBODY = (1.0, 1.0, 0.25)
"""Nothing scores as high as a stretch with itself: there are no closures."""


def test_a_choice_is_made_by_the_others_on_their_own_drifts_and_by_ratios() -> None:
    numbers: dict[DriftedWalk, Errors] = {}
    for name, drifted, bold, shy in (("a", 10.0, 1.0, 2.0), ("b", 1.0, 0.4, 0.3), ("c", 1, 9, 1)):
        for seed in CHOICE_SEEDS:
            numbers[DriftedWalk(name, seed)] = {
                RECKONED: drifted, str(BOLD): bold, str(SHY): shy
            }  # fmt: skip
    assert best_choice(["a", "b"], (BOLD, SHY), numbers) == BOLD
    assert best_choice(["b"], (BOLD, SHY), numbers) == SHY
    assert best_choice(["a", "b", "c"], (BOLD, SHY), numbers) == SHY


def test_a_set_is_mapped_with_what_the_other_chose(shared_data: Path) -> None:
    records = measure_magnetic_left_out(
        StudyContext(shared_data), sets=("square", "eight"), choices=(BOLD, NOBODY)
    )
    found = {(r.world, r.method, r.metric): r.value for r in records}
    for name, share in (("square", 0.4), ("eight", 0.8)):
        assert found[name, LEFT_OUT, "threshold"] == BOLD[0]
        assert found[name, LEFT_OUT, RMSE] < share * found[name, RECKONED, RMSE]
