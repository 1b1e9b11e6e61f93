"""Similarity against displacement, in small, and recall of planted places."""

import numpy as np
import pytest

from elfslam.baselines.generic import unit_rows
from studies.displacement import MOVED_M, RECALL, STUDY, recall
from studies.plain_features import PLAIN, compared_encoders
from studies.results import Record
from studies.study import StudyContext


@pytest.fixture(scope="module")
def found() -> list[Record]:
    mine = {"mine": compared_encoders()[PLAIN]}
    return list(STUDY.measure(StudyContext(), encoders=mine, **STUDY.fast))


def curve(found: list[Record], method: str) -> list[float]:
    chosen = [each for each in found if (each.metric, each.method) == (RECALL, method)]
    assert [each.condition for each in chosen] == [f"{100 * far:g} cm" for far in MOVED_M]
    return [each.value for each in chosen]


def test_the_elf_knows_a_place_from_a_decimetre_away(found: list[Record]) -> None:
    elf, plain = (curve(found, name) for name in ("ELF", PLAIN))
    assert elf[4] > 0.8 > plain[4]
    assert elf[8] < 0.5
    assert curve(found, "mine") == plain, "the same feature under a name of its own"


def test_recall_counts_what_is_more_similar_than_others() -> None:
    generator = np.random.default_rng(4)
    here = unit_rows(generator.standard_normal((200, 64)).astype(np.float32))
    other = ~np.eye(200, dtype=bool)
    moved = here.copy()
    moved[:50] = here[::-1][:50]
    assert recall(here, moved, other) == pytest.approx(0.75)
