"""Damaged and hostile files through the real commands: refused in a line, or done.

`HOSTILE_CASES` says how many cases are tried, `--hypothesis-seed=N` tries others.
"""

from __future__ import annotations

import os
import random
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest
from cases import FAMILIES, PROPERTY, TARGETS, Tally, Target, copied, damaged, run
from forked_commands import Commands
from hypothesis import HealthCheck, Phase, core, given, seed, settings
from hypothesis import strategies as st

pytestmark = pytest.mark.hostile
CASES = int(os.environ.get("HOSTILE_CASES", "200"))
USUAL_SEED = 20


@pytest.mark.parametrize("family", FAMILIES)
def test_damaged_files_are_refused_in_a_line_or_done(
    base: Path, commands: Commands, family: str, record_property: Callable[[str, object], None]
) -> None:
    targets = [target for target in TARGETS if target.family == family]
    share = round(CASES * len(targets) / len(TARGETS))
    tally = Tally()

    @given(target=st.sampled_from(targets), number=st.integers(0, 2**64 - 1))
    @settings(
        max_examples=max(share, 1),
        derandomize=False,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    def tried(target: Target, number: int) -> None:
        chance = random.Random(number)
        with tempfile.TemporaryDirectory(dir=base.parent) as name:
            copy = copied(base, target.given, Path(name))
            done = damaged(copy, chance)
            ended, faults = run(commands, target, copy, base, Path(name))
        tally.count(f"{target}, {done}, {number}", ended, faults)

    chosen = core.global_force_seed
    (tried if chosen is not None else seed(USUAL_SEED)(tried))()
    record_property(PROPERTY, asdict(tally))
    assert not tally.faults, "\n".join(tally.faults)
    assert tally.refused > tally.cases / 10
