"""Floor level: what it learns, resumes, averages and refuses.

The toy floor has spots whose echoes are a sound of the spot under a louder one of the direction,
which the shipped encoder has not learnt to overhear.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from elfslam.base.errors import ParameterError, StoreError
from elfslam.base.values import ECHO_SAMPLES
from elfslam.learn import floor_level
from elfslam.learn.loss import spot_contrast
from elfslam.learn.onnx_files import network_of
from elfslam.learn.parameters import FloorLevelParameters
from elfslam.learn.resumable import TrainingStep
from elfslam.stages.feature import OnnxEncoder, load_encoder, mean_normalised
from elfslam.stages.floormap import SpotEchoes, spot_means

SPOTS_M = np.column_stack([np.arange(12.0), np.zeros(12)])
TOY = FloorLevelParameters(
    steps=6, opening_batches=2, warmup_steps=2, checkpoint_steps=2, near_m=0.3
)


def shipped() -> OnnxEncoder:
    encoder = load_encoder("compact")
    return encoder


def toy_echoes(step: int, *, count: int = 24) -> SpotEchoes:
    drawn = np.random.default_rng([3, step])
    fixed = np.random.default_rng(0)
    decay = np.exp(-np.arange(ECHO_SAMPLES) / 700)
    spot_sounds = fixed.standard_normal((len(SPOTS_M), ECHO_SAMPLES))
    direction_sounds = fixed.standard_normal((4, ECHO_SAMPLES))
    spot, quarter = drawn.integers(0, len(SPOTS_M), count), drawn.integers(0, 4, count)
    hiss = 0.3 * drawn.standard_normal((count, ECHO_SAMPLES))
    samples = 0.01 * decay * (spot_sounds[spot] + 1.5 * direction_sounds[quarter] + hiss)
    return SpotEchoes(samples, SPOTS_M[spot], quarter * np.pi / 2)


def learnt(
    folder: Path,
    parameters: FloorLevelParameters = TOY,
    *,
    seed: int = 0,
    echoes_of: floor_level.EchoesOf = toy_echoes,
    report: Callable[[TrainingStep], None] = lambda progress: None,
) -> floor_level.FloorLevel:
    return floor_level.learn_floor(
        shipped(), SPOTS_M, echoes_of, parameters,
        seed=seed, checkpoint=folder / "floor.checkpoint", report=report,
    )  # fmt: skip


def named_rightly(encoder: OnnxEncoder) -> float:
    """Share of echoes that training never heard whose nearest floor-level ELF is of their spot."""
    spots = floor_level.floor_elfs(encoder, SPOTS_M, (toy_echoes(step) for step in range(100, 106)))
    asked = toy_echoes(200, count=100)
    best = (encoder.embed(asked.samples) @ spots.T).argmax(axis=1)
    return float((SPOTS_M[best, 0] == asked.xy_m[:, 0]).mean())


@pytest.mark.parametrize(("part", "rate"), [("whole", 2e-3), ("head", 2e-3)])
def test_spots_are_known_again_in_any_direction(tmp_path: Path, part: str, rate: float) -> None:
    known = replace(TOY, part=part, learning_rate=rate, steps=40)
    found = learnt(tmp_path, known)
    assert found.losses[-5:].mean() < 0.5 * found.losses[0]
    assert named_rightly(found.encoder) > named_rightly(shipped()) + 0.1
    assert named_rightly(found.encoder) > 0.9


def test_the_head_alone_leaves_the_body_as_it_was(tmp_path: Path) -> None:
    before = network_of(shipped().content)
    after = network_of(learnt(tmp_path, replace(TOY, part="head")).encoder.content)
    samples = torch.tensor(toy_echoes(0).samples)
    torch.testing.assert_close(before.inner(samples), after.inner(samples), atol=1e-4, rtol=1e-3)
    moved = (before.head[0].weight - after.head[0].weight).abs().max()
    assert moved > 1e-4


def test_a_killed_training_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    whole = learnt(tmp_path / "a") if (tmp_path / "a").mkdir() is None else None

    class KilledError(Exception):
        pass

    def killed(progress: TrainingStep) -> None:
        if progress.step == 5:
            raise KilledError

    with pytest.raises(KilledError):
        learnt(tmp_path, report=killed)
    heard: list[int] = []

    def listened(step: int) -> SpotEchoes:
        heard.append(step)
        return toy_echoes(step)

    resumed = learnt(tmp_path, echoes_of=listened)
    assert min(heard) == 4, "what was heard before is not heard again"
    assert resumed.encoder.content == whole.encoder.content
    np.testing.assert_array_equal(resumed.losses, whole.losses)


def test_another_seed_or_place_refuses_the_checkpoint(tmp_path: Path) -> None:
    learnt(tmp_path)
    with pytest.raises(StoreError, match="another seed"):
        learnt(tmp_path, seed=1)


def test_an_unknown_part_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="whole or head"):
        learnt(tmp_path, replace(TOY, part="tail"))


def test_the_card_says_that_a_floor_was_learnt(tmp_path: Path) -> None:
    card = learnt(tmp_path).encoder.card
    assert card.finetunings[-1].parent == shipped().identity
    assert card.finetunings[-1].echoes == 24 * TOY.steps
    assert card.finetunings[-1].outcome.startswith("floor level")


def test_the_loss_of_a_batch_is_that_of_its_cosines() -> None:
    draw = np.random.default_rng(0)
    spots = draw.standard_normal((len(SPOTS_M), 128)).astype(np.float32)
    network = floor_level.FloorNetwork(network_of(shipped().content).eval(), spots)
    batch = toy_echoes(0)
    unit = spots / np.linalg.norm(spots, axis=1, keepdims=True)
    logits = shipped().embed(batch.samples) @ unit.T / TOY.temperature
    square_m2 = (batch.xy_m[:, :1] - SPOTS_M[:, 0]) ** 2
    wanted = np.exp(-square_m2 / (2 * TOY.near_m**2))
    wanted /= wanted.sum(axis=1, keepdims=True)
    log_share = logits - np.log(np.exp(logits).sum(axis=1, keepdims=True))
    by_hand = -(wanted * log_share).sum(axis=1).mean()
    loss = floor_level.batch_loss(network, SPOTS_M, batch, TOY).detach()
    assert float(loss) == pytest.approx(by_hand, rel=1e-4)


def test_contrast_wants_the_near_spots_and_nothing_else() -> None:
    square_m2 = torch.tensor([[0.0, 0.01, 4.0]])
    right = spot_contrast(torch.tensor([[5.0, 4.5, 0.0]]), square_m2, 0.1)
    wrong = spot_contrast(torch.tensor([[0.0, 4.5, 5.0]]), square_m2, 0.1)
    assert right < wrong
    logits = torch.log(torch.softmax(-square_m2 / 0.02, dim=1) + 1e-30)
    assert spot_contrast(logits, square_m2, 0.1) < right, "its own shares cost least"


def test_the_spots_lose_what_the_echoes_of_a_walk_have_in_common() -> None:
    encoder = load_encoder("compact")
    walks = [toy_echoes(step) for step in (100, 101)]
    heard = [(w.xy_m, w.heading_rad, mean_normalised(encoder.embed(w.samples))) for w in walks]
    found = floor_level.floor_elfs(encoder, SPOTS_M, walks)
    np.testing.assert_allclose(found, spot_means(SPOTS_M, heard), atol=1e-6)
