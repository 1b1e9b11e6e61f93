"""Fine-tuning: it helps where it must, keeps the encoder where it hurts, and never looks at names.

The toy is a walk of three rounds: every place has echoes of its own under a loud part that all
places share, which the pre-trained encoder has not learnt to overhear.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from elfslam.base.arrays import F32, Bool
from elfslam.base.card import Card
from elfslam.base.errors import InputError
from elfslam.base.parameters import digest
from elfslam.base.values import ECHO_SAMPLES, Echoes
from elfslam.learn import finetune as tuning
from elfslam.learn.finetune import Finetuned, augmented, beside, finetune, walk_loss, walk_of
from elfslam.learn.loss import nt_xent
from elfslam.learn.network import CompactEncoder
from elfslam.learn.onnx_files import encoder_content, network_of
from elfslam.learn.parameters import FinetuneParameters
from elfslam.stages.feature import OnnxEncoder, load_encoder

ROUND, ROUNDS, ANCHOR = 200, 3, 8
SCHEDULE = {"steps": 30, "warmup_steps": 3, "check_steps": 10, "learning_rate": 2e-3, "pairs": 48}
STRETCHES = {"beside_windows": 1, "block_s": 10.0, "shortest_s": 30.0}
TOY = FinetuneParameters(line_similarity=0.65, threads=1, **SCHEDULE, **STRETCHES)
"""What all places share makes them resemble each other, so a line is asked for more."""


def toy_echoes(seed: int = 0, *, shared: float = 1.5, noise: float = 1.0) -> Echoes:
    """Three rounds of 20 s past 25 spots; between two spots the sound changes over smoothly."""
    draw = np.random.default_rng(seed)
    decay = np.exp(-np.arange(ECHO_SAMPLES) / 700)
    spots = draw.standard_normal((ROUND // ANCHOR, ECHO_SAMPLES))
    at = np.arange(ROUND * ROUNDS) / ANCHOR
    share = (at % 1)[:, None]
    before, after = (spots[(at.astype(int) + k) % len(spots)] for k in (0, 1))
    place = np.sqrt(1 - share) * before + np.sqrt(share) * after
    hiss = noise * draw.standard_normal((len(at), ECHO_SAMPLES))
    samples = 0.01 * decay * (place + shared * draw.standard_normal(ECHO_SAMPLES) + hiss)
    t_s = np.arange(len(at)) * 0.1
    return Echoes(t_s, samples.astype(np.float32), np.zeros((0, 2)))


def same_place(echoes: Echoes) -> tuple[Bool, Bool]:
    """Pairs of echoes of different rounds at one spot, and pairs at others."""
    number = np.arange(len(echoes.t_s))
    apart = np.abs((number[:, None] - number + ROUND // 2) % ROUND - ROUND // 2)
    rounds = number[:, None] // ROUND != number // ROUND
    return rounds & (apart <= 1), apart > 2 * ANCHOR


def recall(encoder: OnnxEncoder, echoes: Echoes) -> float:
    """Of echoes of the same place, by what was planted, at 1 % false positives."""
    rows = encoder.embed(echoes.samples)
    same, other = same_place(echoes)
    scores = rows @ rows.T
    return float((scores[same] > np.quantile(scores[other], 0.99)).mean())


@pytest.fixture(scope="module")
def encoder() -> OnnxEncoder:
    shipped = load_encoder("compact")
    card = Card("Encoder: known", metrics={"a": 1.0})
    return OnnxEncoder(encoder_content(network_of(shipped.content), card), "known")


@pytest.fixture(scope="module")
def echoes() -> Echoes:
    return toy_echoes()


@pytest.fixture(scope="module")
def tuned(encoder: OnnxEncoder, echoes: Echoes) -> Finetuned:
    return finetune(encoder, echoes, TOY, seed=0)


def test_the_weights_come_back_out_of_the_file(encoder: OnnxEncoder, echoes: Echoes) -> None:
    network = network_of(encoder.content)
    with torch.no_grad():
        rows = network(torch.from_numpy(np.array(echoes.samples[:50])))
    np.testing.assert_allclose(rows.numpy(), encoder.embed(echoes.samples[:50]), atol=1e-5)
    again = OnnxEncoder(encoder_content(network), "again").embed(echoes.samples[:50])
    np.testing.assert_allclose(again, rows.numpy(), atol=1e-5)


def test_an_encoder_of_another_width_comes_back_too() -> None:
    torch.manual_seed(0)
    network, samples = CompactEncoder(8), torch.randn(16, ECHO_SAMPLES)
    network.train()(samples)
    back = network_of(encoder_content(network))
    with torch.no_grad():
        one, other = (net.eval()(samples) for net in (network, back))
    np.testing.assert_allclose(one.numpy(), other.numpy(), atol=1e-5)


@pytest.mark.parametrize("content", [b"", b"no graph"])
def test_a_foreign_file_is_no_network(content: bytes) -> None:
    with pytest.raises(InputError, match="wanted the compact network"):
        network_of(content)


def test_it_helps_where_the_places_share_a_loud_part(
    encoder: OnnxEncoder, echoes: Echoes, tuned: Finetuned
) -> None:
    assert tuned.changed
    before, after = recall(encoder, echoes), recall(tuned.encoder, echoes)
    assert after > before + 0.08
    assert tuned.encoder.identity != encoder.identity
    assert "->" in tuned.reason


def test_the_same_seed_gives_the_same_bytes(
    encoder: OnnxEncoder, echoes: Echoes, tuned: Finetuned
) -> None:
    short = replace(TOY, steps=4, check_steps=2)
    one, two = (finetune(encoder, echoes, short, seed=5) for _ in range(2))
    assert one.encoder.content == two.encoder.content
    assert one.checks == two.checks
    other = finetune(encoder, echoes, short, seed=6)
    assert other.checks != one.checks or other.encoder.content != one.encoder.content


def test_its_card_adds_the_fine_tuning_to_another(encoder: OnnxEncoder, tuned: Finetuned) -> None:
    parent, found = encoder.card, tuned.encoder.card
    assert found.text == parent.text
    assert found.metrics == {} != parent.metrics, "figures of the parent are not its own"
    made = found.finetunings[-1]
    assert (made.parent, made.seed, made.echoes) == (encoder.identity, 0, ROUND * ROUNDS)
    assert made.outcome == tuned.reason
    assert made.parameters["steps"] == TOY.steps
    assert made.parameters_digest == digest(TOY)


def test_what_was_fine_tuned_twice_says_so(tuned: Finetuned, echoes: Echoes) -> None:
    """The second time nothing may be won, and then the file stays as it is."""
    first = tuned.encoder.card
    again = finetune(tuned.encoder, echoes, replace(TOY, steps=4, check_steps=4), seed=1)
    second = again.encoder.card
    assert second.finetunings[: len(first.finetunings)] == first.finetunings
    assert len(second.finetunings) == len(first.finetunings) + again.changed


def test_where_it_hurts_the_encoder_is_kept(encoder: OnnxEncoder, echoes: Echoes) -> None:
    """A learning rate that wrecks any network: the look at the quality notices."""
    seen: list[tuning.Check] = []
    wild = replace(TOY, steps=10, learning_rate=30.0, keep=0.0)
    wrecked = finetune(encoder, echoes, wild, seed=0, report=seen.append)
    assert wrecked.encoder is encoder
    assert not wrecked.changed
    assert "does not help" in wrecked.reason
    assert tuple(seen) == wrecked.checks[1:]
    assert max(check.quality for check in seen) <= wrecked.checks[0].quality


def test_a_walk_out_of_order_teaches_nothing(encoder: OnnxEncoder, echoes: Echoes) -> None:
    order = np.random.default_rng(0).permutation(len(echoes.t_s))
    shuffled = Echoes(echoes.t_s, echoes.samples[order], echoes.losses_s)
    found = finetune(encoder, shuffled, TOY, seed=0)
    assert found.encoder is encoder
    assert "nothing to judge by" in found.reason


def test_what_is_learnt_from_and_what_is_spared(encoder: OnnxEncoder, echoes: Echoes) -> None:
    walk = walk_of(encoder.embed(echoes.samples), echoes, TOY)
    t_s = echoes.t_s
    assert not walk.held_out[walk.window[walk.first]].any()
    assert not walk.held_out[walk.window[walk.first + 1]].any()
    assert 0.1 < walk.held_out.mean() < 0.3
    near = np.abs(t_s[:, None] - t_s) < TOY.near_s - TOY.window * 0.1
    spared = walk.spared[np.ix_(walk.window, walk.window)]
    assert spared[near].all()
    same, _ = same_place(echoes)
    assert spared[same].mean() > 0.9, "the rounds are found without a label"
    assert not (walk.spared & walk.other).any()
    assert not (walk.revisit & ~walk.spared).any()


def test_an_echo_behind_a_gap_is_no_positive(encoder: OnnxEncoder, echoes: Echoes) -> None:
    t_s = echoes.t_s + 3.0 * (np.arange(len(echoes.t_s)) >= 25)
    broken = Echoes(t_s, echoes.samples, echoes.losses_s)
    first = walk_of(encoder.embed(echoes.samples), broken, TOY).first
    assert 23 in first
    assert 24 not in first
    assert 25 in first


def test_spared_pairs_do_not_push_but_stay_similar(encoder: OnnxEncoder, echoes: Echoes) -> None:
    """Where everything is spared, only what has moved is left to lose."""
    still = replace(TOY, jitter_samples=0, noise=0.0)
    walk = walk_of(encoder.embed(echoes.samples), echoes, still)
    all_spared = replace(walk, spared=np.ones_like(walk.spared))
    draw = torch.Generator().manual_seed(0)
    rows = walk.first[:64:8]
    untouched = walk_loss(network_of(encoder.content), all_spared, rows, still, draw)
    assert float(untouched.detach()) == pytest.approx(0.0, abs=1e-6)
    torch.manual_seed(0)
    moved = walk_loss(CompactEncoder(8).eval(), all_spared, rows, still, draw)
    assert float(moved.detach()) > 0.01


def test_without_spared_pairs_it_is_plain_nt_xent(encoder: OnnxEncoder, echoes: Echoes) -> None:
    still = replace(TOY, jitter_samples=0, noise=0.0)
    walk = walk_of(encoder.embed(echoes.samples), echoes, still)
    none_spared = replace(walk, spared=np.zeros_like(walk.spared))
    rows = walk.first[:64:8]
    chance = torch.Generator().manual_seed(0)
    loss = walk_loss(network_of(encoder.content), none_spared, rows, still, chance)
    views = walk.vectors[rows], walk.vectors[rows + 1]
    expected = nt_xent(*views, torch.zeros(len(rows), len(rows), dtype=torch.bool), 0.1)
    assert float(loss.detach()) == pytest.approx(float(expected), abs=1e-4)


def test_an_echo_is_cut_anew_within_the_jitter(echoes: Echoes) -> None:
    quiet = replace(TOY, noise=0.0, jitter_samples=2)
    samples = torch.from_numpy(np.array(echoes.samples[:40]))
    made = augmented(samples, quiet, torch.Generator().manual_seed(0))
    shifts = set()
    for before, after in zip(samples, made, strict=True):
        fits = [k for k in range(-2, 3) if torch.equal(before.roll(-k)[2:-2], after[2:-2])]
        assert len(fits) == 1
        shifts.add(fits[0])
    assert shifts == {-2, -1, 0, 1, 2}
    noisy = augmented(samples, replace(quiet, jitter_samples=0, noise=0.5), torch.Generator())
    share = (noisy - samples).square().mean(dim=1).sqrt() / samples.square().mean(dim=1).sqrt()
    assert float(share.max()) < 0.55
    assert float(share.max() - share.min()) > 0.2


def cut_to(echoes: Echoes, count: int) -> Echoes:
    return Echoes(echoes.t_s[:count], echoes.samples[:count], echoes.losses_s)


@pytest.mark.parametrize(
    ("count", "changes", "words"),
    [
        (0, {}, "wanted echoes of 30 s, got 0 s; walk longer"),
        (250, {}, "wanted echoes of 30 s, got 25 s; walk longer"),
        (310, {"pairs": 310}, "wanted 310 consecutive echoes, got"),
    ],
)
def test_too_short_a_walk_is_refused(
    count: int, changes: dict[str, int], words: str, encoder: OnnxEncoder, echoes: Echoes
) -> None:
    with pytest.raises(InputError, match=words):
        finetune(encoder, cut_to(echoes, count), replace(TOY, **changes), seed=0)


def unit_rows(count: int, seed: int = 0) -> F32:
    rows = np.random.default_rng(seed).standard_normal((count, 64))
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), dtype=np.float32)


def test_windows_are_means_of_consecutive_echoes() -> None:
    window = tuning.windows_of(7, 3)
    assert window.tolist() == [0, 0, 0, 1, 1, 1, 2]
    means = tuning.window_means(np.arange(7, dtype=np.float32)[:, None], window)
    assert means[:, 0].tolist() == [1.0, 4.0, 6.0]


@pytest.mark.parametrize("back", [False, True])
def test_a_stretch_walked_again_is_found_and_a_single_likeness_is_not(back: bool) -> None:
    rows = unit_rows(40)
    rows[25:35] = rows[5:15][::-1] if back else rows[5:15]
    rows[20] = rows[1]
    found = tuning.likely_revisits(rows, 5, 0.5)
    here = np.arange(7, 13)
    assert found[here, 39 - here if back else here + 20].all()
    assert not found[1, 20]
    assert (found == found.T).all()
    assert found.diagonal().all(), "every stretch is like itself"


def test_the_mean_along_a_line_is_that_of_a_loop() -> None:
    rows = unit_rows(12, 3)
    scores = rows @ rows.T
    for threshold in (-0.05, 0.0, 0.05):
        found = tuning.likely_revisits(rows, 5, threshold)
        for i in range(12):
            for j in range(12):
                means = [
                    np.mean([
                        scores[i + k, j + turn * k]
                        for k in range(-2, 3)
                        if 0 <= i + k < 12 and 0 <= j + turn * k < 12
                    ])
                    for turn in (1, -1)
                ]  # fmt: skip
                most = max(means)
                assert abs(most - threshold) < 1e-5 or found[i, j] == (most >= threshold)


def test_beside_reaches_as_far_as_asked() -> None:
    pairs = np.zeros((9, 9), dtype=bool)
    pairs[4, 2] = True
    assert (beside(pairs, 0) == pairs).all()
    assert np.argwhere(beside(pairs, 1)).tolist() == [[i, j] for i in (3, 4, 5) for j in (1, 2, 3)]
