"""Data-parallel training: two processes with half of the batch each take the step of one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from planted_training import STEP, TINY, stepped, toy_pairs
from torch import nn

from elfslam.base.errors import ParameterError, StoreError
from elfslam.learn.distributed import (
    ALONE,
    NormOfAll,
    Ranks,
    check_shares,
    joined,
    norms_of_all,
    rows_of_all,
    shares,
    start_together,
)
from elfslam.learn.network import CompactEncoder
from elfslam.learn.resumable import prefetched

PROGRAM = str(Path(__file__).with_name("planted_training.py"))
TORCHRUN = (sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2")


def test_two_processes_find_the_gradients_of_one(tmp_path: Path) -> None:
    quiet = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run([*TORCHRUN, PROGRAM, "step", str(tmp_path / "found")], check=True, env=quiet)
    wanted = stepped(toy_pairs(STEP))
    size = max(abs(value).max() for value in wanted.values())
    for number in range(2):
        found = dict(np.load(tmp_path / f"found.{number}.npz"))
        assert found.keys() == wanted.keys()
        for name, value in wanted.items():
            np.testing.assert_allclose(found[name], value, rtol=0, atol=1e-13 * size, err_msg=name)


def test_each_by_itself_would_find_another_loss() -> None:
    """What the processes tell each other matters: half a batch has fewer negatives, other norms."""
    whole = toy_pairs(STEP)
    half = type(whole)(whole.first[:4], whole.second[:4], whole.room[:4], whole.xy_m[:4])
    assert abs(stepped(half)["loss"] - stepped(whole)["loss"]) > 0.01


def test_alone_nothing_is_changed_and_nothing_gathered() -> None:
    network, rows = CompactEncoder(4), torch.ones(3, 2)
    norms_of_all(network, ALONE)
    assert not any(isinstance(module, NormOfAll) for module in network.modules())
    assert torch.equal(rows_of_all(rows, ALONE), rows[None])
    steps = [step for step, _ in shares(prefetched, toy_pairs, 2, 5, ALONE)]
    assert steps == [2, 3, 4]


def test_once_trained_the_norm_is_the_plain_one() -> None:
    torch.manual_seed(0)
    norm = nn.BatchNorm2d(3)
    norm(torch.randn(8, 3, 4, 4))
    x = torch.randn(2, 3, 4, 4)
    other = NormOfAll(norm, Ranks(0, 2)).eval()
    assert torch.equal(other(x), norm.eval()(x))
    assert other.state_dict().keys() == norm.state_dict().keys()


@pytest.mark.parametrize("count", [3, 8])
def test_numbers_that_cannot_share_a_batch_are_refused(count: int) -> None:
    with pytest.raises(ParameterError, match=f"torchrun: got {count} processes, wanted a number"):
        check_shares(TINY.pairs, Ranks(0, count))


def test_processes_that_see_different_checkpoints_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def gathered(each: list[int], steps: int) -> None:
        each[:] = [steps, 0]

    monkeypatch.setattr(torch.distributed, "all_gather_object", gathered)
    start_together(0, Ranks(0, 2))
    with pytest.raises(StoreError, match=r"the processes see steps \[4, 0\]; put it on a disk"):
        start_together(4, Ranks(0, 2))


def test_an_environment_that_names_no_group_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    for name in ("RANK", "MASTER_ADDR", "MASTER_PORT"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ParameterError, match="launch with torchrun, or unset it"), joined():
        pass
