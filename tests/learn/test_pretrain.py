"""Pre-training: it learns, it resumes where it was, and it refuses what it cannot resume."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from planted_training import toy_pairs
from torch import nn

from elfslam.base.errors import StoreError
from elfslam.base.values import EchoPairs
from elfslam.learn import pretrain as pretraining
from elfslam.learn.network import CompactEncoder, ResNetEncoder
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.pretrain import PairsOf, build_network, pair_loss, pretrain, training_device
from elfslam.learn.resumable import TrainingStep, prefetched, warm_cosine

TINY = PretrainParameters(
    steps=4, pairs=8, width=4, warmup_steps=2, learning_rate=3e-3, checkpoint_steps=2
)


class KilledError(Exception):
    """Stands for whatever ends a training run early."""


def run(folder: Path, parameters: PretrainParameters = TINY, **how: Any) -> nn.Module:
    return trained(folder, parameters, **how).network


def trained(
    folder: Path,
    parameters: PretrainParameters = TINY,
    *,
    pairs_of: PairsOf = toy_pairs,
    report: Callable[[TrainingStep], None] = lambda progress: None,
    seed: int = 0,
) -> pretraining.Pretrained:
    return pretrain(
        pairs_of, parameters, seed=seed, checkpoint=folder / "training.pt", report=report
    )


def killed_after(step: int) -> Callable[[TrainingStep], None]:
    def report(progress: TrainingStep) -> None:
        if progress.step > step:
            raise KilledError

    return report


def same_weights(one: nn.Module, other: nn.Module) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


def test_the_loss_falls(tmp_path: Path) -> None:
    losses: list[float] = []
    parameters = replace(TINY, steps=20, warmup_steps=3)
    note = {"report": lambda progress: losses.append(progress.loss)}
    network = run(tmp_path, parameters, pairs_of=lambda step: toy_pairs(0), **note)
    assert len(losses) == 20
    assert losses[-1] < 0.2 * losses[0]
    assert not network.training


def test_what_was_learnt_holds_for_places_never_seen(tmp_path: Path) -> None:
    unseen = toy_pairs(1000, count=64)
    trained = run(tmp_path, replace(TINY, steps=25), pairs_of=lambda k: toy_pairs(k, count=24))
    torch.manual_seed(0)
    fresh = CompactEncoder(4).eval()
    with torch.no_grad():
        learnt, guessed = (float(pair_loss(net, unseen, TINY)) for net in (trained, fresh))
    assert learnt < 0.75 * guessed


def test_a_killed_run_goes_on_where_it_was(tmp_path: Path) -> None:
    """Two steps, a kill, and two more: bit for bit the four steps in one go, losses too."""
    straight, broken = tmp_path / "straight", tmp_path / "broken"
    straight.mkdir()
    broken.mkdir()
    seen: list[float] = []
    whole = trained(straight, report=lambda progress: seen.append(progress.loss))
    with pytest.raises(KilledError):
        run(broken, report=killed_after(2))
    steps: list[int] = []
    resumed = trained(broken, report=lambda progress: steps.append(progress.step))
    assert steps == [3, 4]
    assert same_weights(whole.network, resumed.network)
    assert whole.losses.tolist() == resumed.losses.tolist() == seen
    assert trained(broken).losses.tolist() == seen, "a finished run knows them too"
    assert not list(tmp_path.rglob("*.partial"))


def by_hand(parameters: PretrainParameters, seed: int) -> nn.Module:
    """The training written out: no device, no checkpoint, no stream."""
    torch.manual_seed(seed)
    torch.set_num_threads(parameters.threads)
    network = CompactEncoder(parameters.width).train()
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=parameters.weight_decay)
    for step in range(parameters.steps):
        warm = min((step + 1) / parameters.warmup_steps, 1.0)
        cosine = 0.5 + 0.5 * math.cos(math.pi * step / parameters.steps)
        optimizer.param_groups[0]["lr"] = parameters.learning_rate * (warm * cosine)
        loss = pair_loss(network, toy_pairs(step), parameters)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return network.eval()


@pytest.mark.skipif(torch.cuda.is_available(), reason="on a GPU other numbers come out")
def test_on_a_processor_it_is_the_plain_training_bit_for_bit(tmp_path: Path) -> None:
    made = trained(tmp_path, seed=2)
    assert made.arithmetic == "float32"
    assert same_weights(made.network, by_hand(TINY, 2))


def test_the_network_is_the_named_one() -> None:
    assert isinstance(build_network(replace(TINY, network="resnet18")), ResNetEncoder)
    compact = build_network(replace(TINY, network="compact", width=6))
    assert isinstance(compact, CompactEncoder)
    assert compact.body[0].out_channels == 6


def test_a_gpu_is_used_where_there_is_one() -> None:
    assert training_device(has_gpu=True).type == "cuda"
    assert training_device(has_gpu=False).type == "cpu"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")
def test_a_gpu_learns_too_and_gives_the_network_back(tmp_path: Path) -> None:
    made = trained(tmp_path, replace(TINY, steps=20), pairs_of=lambda step: toy_pairs(0))
    assert made.arithmetic == "bfloat16 on a GPU"
    assert made.losses[-1] < 0.4 * made.losses[0]
    assert {value.device.type for value in made.network.state_dict().values()} == {"cpu"}


def test_every_step_gets_its_own_batch_in_order(tmp_path: Path) -> None:
    """However far ahead batches are made, no more than a few wait, and none is skipped."""
    asked: list[int] = []
    lead: list[int] = []

    def pairs_of(step: int) -> EchoPairs:
        asked.append(step)
        return toy_pairs(step)

    note = {"report": lambda progress: lead.append(max(asked) - progress.step)}
    run(tmp_path, replace(TINY, steps=12), pairs_of=pairs_of, **note)
    assert asked == list(range(12))
    assert max(lead) <= 3


def test_a_failing_stream_ends_the_training(tmp_path: Path) -> None:
    def pairs_of(step: int) -> EchoPairs:
        if step == 2:
            raise KilledError
        return toy_pairs(step)

    with pytest.raises(KilledError):
        run(tmp_path, pairs_of=pairs_of)


@pytest.mark.parametrize("content", [b"", b"not a checkpoint", b"PK\x03\x04 torn"])
def test_a_damaged_checkpoint_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "training.pt").write_bytes(content)
    with pytest.raises(StoreError, match=r"training\.pt: not a checkpoint of this network; delete"):
        run(tmp_path)
    assert (tmp_path / "training.pt").read_bytes() == content


def test_a_checkpoint_of_another_network_is_refused(tmp_path: Path) -> None:
    run(tmp_path)
    with pytest.raises(StoreError, match="another seed, parameters or arithmetic"):
        run(tmp_path, replace(TINY, width=8))


@pytest.mark.parametrize("missing", ["losses", "network", "optimizer"])
def test_a_checkpoint_without_its_parts_is_refused(tmp_path: Path, missing: str) -> None:
    run(tmp_path)
    path = tmp_path / "training.pt"
    state = torch.load(path, weights_only=True)
    torch.save({key: value for key, value in state.items() if key != missing}, path)
    with pytest.raises(StoreError, match="not a checkpoint"):
        run(tmp_path)


def test_places_too_near_are_no_negatives() -> None:
    """All eight places of one room within reach of each other: only positives are left."""
    batch, network = toy_pairs(0), CompactEncoder(4).eval()
    together = replace(batch, room=np.zeros(8, dtype=np.int64), xy_m=np.zeros((8, 2)))
    apart = replace(together, room=np.arange(8))
    with torch.no_grad():
        assert float(pair_loss(network, together, TINY)) == pytest.approx(0.0, abs=1e-6)
        assert float(pair_loss(network, apart, TINY)) > 0.5


def test_batches_come_in_order_and_only_those_asked_for() -> None:
    made: list[int] = []

    def batch(step: int) -> int:
        made.append(step)
        return step * step

    assert list(prefetched(batch, 3, 9)) == [(k, k * k) for k in range(3, 9)]
    assert made == list(range(3, 9))
    assert list(prefetched(batch, 9, 9)) == []


def test_the_rate_rises_to_its_peak_and_falls_to_nothing() -> None:
    rates = [warm_cosine(step, 10, 1000) for step in range(1001)]
    assert rates[0] == pytest.approx(0.1)
    assert max(rates) == pytest.approx(1.0, abs=1e-3)
    assert rates[500] == pytest.approx(0.5)
    assert rates[1000] == pytest.approx(0.0, abs=1e-9)
