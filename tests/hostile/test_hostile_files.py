"""Damaged and hostile files through the real commands: refused in a line, or done.

`HOSTILE_CASES` says how many cases are tried, `--hypothesis-seed=N` tries others.
"""

import os
import random
import tempfile
from pathlib import Path

import pytest
from cases import FAMILIES, TARGETS, Target, copied, damaged, run
from forked_commands import Commands
from hypothesis import HealthCheck, Phase, core, given, seed, settings
from hypothesis import strategies as st

pytestmark = pytest.mark.hostile
CASES = int(os.environ.get("HOSTILE_CASES", "200"))
USUAL_SEED = 20


@pytest.mark.parametrize("family", FAMILIES)
def test_damaged_files_are_refused_in_a_line_or_done(
    base: Path, commands: Commands, family: str
) -> None:
    targets = [target for target in TARGETS if target.family == family]
    share = round(CASES * len(targets) / len(TARGETS))
    codes, faults = list[int](), list[str]()

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
            ended, wrong = run(commands, target, copy, base, Path(name))
        codes.append(ended.code)
        faults.extend(f"{each}: {target}, {done}, {number}" for each in wrong)

    chosen = core.global_force_seed
    (tried if chosen is not None else seed(USUAL_SEED)(tried))()
    assert not faults, "\n".join(faults)
    assert codes.count(2) > len(codes) / 10
