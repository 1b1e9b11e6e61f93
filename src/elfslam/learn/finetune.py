"""Fine-tuning without labels: the encoder learns the one walk that it is to map."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.ndimage import maximum_filter
from torch import Tensor

from elfslam import __version__
from elfslam.base.arrays import F32, F64, I64, Bool
from elfslam.base.card import Card, Finetuning, training_facts
from elfslam.base.errors import InputError
from elfslam.base.values import Echoes
from elfslam.learn.loss import nt_xent
from elfslam.learn.network import CompactEncoder
from elfslam.learn.onnx_files import encoder_content, network_of
from elfslam.learn.parameters import FinetuneParameters
from elfslam.stages.feature import OnnxEncoder

HELD_OUT_OF = 5
"""One time block in five is not learnt from."""
FALSE_SHARE = 0.01
ROWS = 256


@dataclass(frozen=True)
class Check:
    """The quality after some steps, see `revisit_recall`."""

    step: int
    quality: float


@dataclass(frozen=True, eq=False)
class Finetuned:
    """The encoder of a walk, whether fine-tuning changed it, and why in one line."""

    encoder: OnnxEncoder
    changed: bool
    reason: str
    checks: tuple[Check, ...]


@dataclass(frozen=True, eq=False)
class TrainingWalk:
    """What is learnt from: echoes (n), and what the pre-trained encoder makes of them.

    `window` (n) is each echo's, `spared` (k, k) are pairs of windows that are no negatives,
    `revisit` (k, k) those of them most likely to be revisits and `other` (k, k) those that are
    neither; `held_out` (k) is not learnt from, `first` are echoes that the next follows at once.
    """

    samples: Tensor
    vectors: Tensor
    window: I64
    spared: Bool
    revisit: Bool
    other: Bool
    held_out: Bool
    first: I64


def finetune(
    encoder: OnnxEncoder,
    echoes: Echoes,
    parameters: FinetuneParameters,
    *,
    seed: int,
    report: Callable[[Check], None] = lambda check: None,
) -> Finetuned:
    """`encoder` after some steps on the echoes of one walk, or as it was where that is better.

    Positives are consecutive echoes (paper, section 5.3), both augmented; negatives all others of
    the batch that neither lie near in time nor may be revisits. Those keep the similarity that
    the pre-trained encoder gave them: so that thresholds go on to mean what they did. Same seed
    and number of threads, same bytes. Raises InputError for a walk too short to learn from and
    for an encoder of another kind.
    """
    torch.set_num_threads(parameters.threads)
    network = network_of(encoder.content)
    card = _card(encoder, echoes, parameters, seed)
    walk = walk_of(encoder.embed(echoes.samples), echoes, parameters)
    if not (walk.revisit[walk.held_out].any() and walk.other[walk.held_out].any()):
        return Finetuned(encoder, False, "no place heard twice, so nothing to judge by", ())
    checks = [Check(0, revisit_recall(walk.vectors.numpy(), walk))]
    best: dict[str, Tensor] = {}
    for step in _steps(network, walk, parameters, seed):
        if step % parameters.check_steps and step != parameters.steps:
            continue
        quality = revisit_recall(_embedded(network, walk.samples), walk)
        if quality > max(check.quality for check in checks):
            best = {name: value.clone() for name, value in network.state_dict().items()}
        checks.append(Check(step, quality))
        report(checks[-1])
    return _judged(encoder, network, best, tuple(checks), card)


def walk_of(vectors: F32, echoes: Echoes, parameters: FinetuneParameters) -> TrainingWalk:
    """What to learn from a walk whose echoes the pre-trained encoder embeds as `vectors`."""
    length_s = float(np.ptp(echoes.t_s)) if len(echoes.t_s) else 0.0
    if length_s < parameters.shortest_s:
        raise InputError(
            f"finetune: wanted echoes of {parameters.shortest_s:g} s, got {length_s:.0f} s; "
            "walk longer, or map without fine-tuning"
        )
    window = windows_of(len(echoes.t_s), parameters.window)
    means = window_means(vectors, window)
    t_s = window_means(echoes.t_s[:, None], window)[:, 0]
    far = np.abs(t_s[:, None] - t_s) >= parameters.near_s
    line = likely_revisits(means, parameters.line_windows, parameters.line_similarity)
    spared = ~far | beside(line, parameters.beside_windows)
    held_out = (t_s // parameters.block_s).astype(int) % HELD_OUT_OF == HELD_OUT_OF - 1
    first = _consecutive(echoes.t_s, held_out[window], parameters.gap_s)
    if len(first) < parameters.pairs:
        raise InputError(
            f"finetune: wanted {parameters.pairs} consecutive echoes, got {len(first)}; "
            "walk longer, or set finetune.pairs"
        )
    return TrainingWalk(
        torch.from_numpy(np.array(echoes.samples)), torch.from_numpy(np.array(vectors)),
        window, spared, line & far, ~spared, held_out, first,
    )  # fmt: skip


def revisit_recall(vectors: F32, walk: TrainingWalk) -> float:
    """How well the likely revisits stand out, on the part of the walk that is not learnt from.

    The share of them that is more similar than all but 1 % of the other pairs far apart in time.
    """
    means = window_means(vectors, walk.window)
    scores = (means @ means.T)[walk.held_out]
    others = scores[walk.other[walk.held_out]]
    return float(
        (scores[walk.revisit[walk.held_out]] > np.quantile(others, 1 - FALSE_SHARE)).mean()
    )


def walk_loss(
    network: CompactEncoder,
    walk: TrainingWalk,
    first: I64,
    parameters: FinetuneParameters,
    draw: torch.Generator,
) -> Tensor:
    """NT-Xent of the echoes `first` and the next, and how far spared pairs moved meanwhile."""
    window = walk.window[first]
    spared = torch.from_numpy(walk.spared[np.ix_(window, window)])
    apart = spared & ~torch.eye(len(first), dtype=torch.bool)
    views, moved = [], torch.zeros(())
    for rows in (first, first + 1):
        view = network(augmented(walk.samples[rows], parameters, draw))
        before = walk.vectors[rows] @ walk.vectors[rows].T
        if apart.any():
            moved = moved + ((view @ view.T - before)[apart] ** 2).mean() / 2
        views.append(view)
    loss = nt_xent(views[0], views[1], spared, parameters.temperature)
    return loss + parameters.keep * moved


def augmented(samples: Tensor, parameters: FinetuneParameters, draw: torch.Generator) -> Tensor:
    """Echoes (n, 2352) cut a little earlier or later, with some noise; the level drops out."""
    most, size = parameters.jitter_samples, samples.shape[1]
    shift = torch.randint(-most, most + 1, (len(samples), 1), generator=draw)
    columns = (torch.arange(size) + shift).clamp(0, size - 1)
    level = samples.square().mean(dim=1, keepdim=True).sqrt()
    loudness = parameters.noise * level * torch.rand(len(samples), 1, generator=draw)
    return samples.gather(1, columns) + loudness * torch.randn(samples.shape, generator=draw)


def _steps(
    network: CompactEncoder, walk: TrainingWalk, parameters: FinetuneParameters, seed: int
) -> Iterator[int]:
    """Train and count the steps. The statistics of the batch norms stay: rows keep apart."""
    draw = torch.Generator().manual_seed(seed)
    network.eval()
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=0.0)
    for step in range(parameters.steps):
        warm = min((step + 1) / parameters.warmup_steps, 1.0)
        cosine = 0.5 + 0.5 * math.cos(math.pi * step / parameters.steps)
        for group in optimizer.param_groups:
            group["lr"] = parameters.learning_rate * warm * cosine
        order = torch.randperm(len(walk.first), generator=draw).numpy()
        loss = walk_loss(network, walk, walk.first[order[: parameters.pairs]], parameters, draw)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        yield step + 1


def _consecutive(t_s: F64, held_out: Bool, gap_s: float) -> I64:
    """Echoes that the next one follows at once, both to be learnt from."""
    follows = np.diff(t_s) <= gap_s
    return np.flatnonzero(follows & ~held_out[:-1] & ~held_out[1:])


def _embedded(network: CompactEncoder, samples: Tensor) -> F32:
    with torch.no_grad():
        parts = [network(part) for part in torch.split(samples, ROWS)]
    return np.asarray(torch.cat(parts).numpy())


def _card(encoder: OnnxEncoder, echoes: Echoes, parameters: FinetuneParameters, seed: int) -> Card:
    """The card of `encoder` with this fine-tuning added, whose outcome is still open.

    Its figures are not those of the parent.
    """
    parent = encoder.card or Card("ELF encoder: fine-tuned from one whose file has no card.")
    made = Finetuning(
        parent=encoder.identity,
        software=f"elfslam {__version__}",
        seed=seed,
        echoes=len(echoes.t_s),
        outcome="",
        **training_facts(parameters),
    )
    return replace(parent, finetunings=(*parent.finetunings, made), metrics={})


def _judged(
    encoder: OnnxEncoder,
    network: CompactEncoder,
    best: dict[str, Tensor],
    checks: tuple[Check, ...],
    card: Card,
) -> Finetuned:
    """The best of all looks; the encoder as it was where none was better than the first."""
    before, after = checks[0].quality, max(check.quality for check in checks[1:])
    heard = f"revisits heard again {100 * before:.1f} -> {100 * after:.1f} %"
    if not best:
        return Finetuned(encoder, False, f"{heard}: fine-tuning does not help here", checks)
    network.load_state_dict(best)
    *earlier, made = card.finetunings
    card = replace(card, finetunings=(*earlier, replace(made, outcome=heard)))
    return Finetuned(OnnxEncoder(encoder_content(network, card), "fine-tuned"), True, heard, checks)


def windows_of(count: int, length: int) -> I64:
    """The window of each of `count` echoes: `length` consecutive ones share one."""
    return np.arange(count) // length


def window_means(values: F32 | F64, window: I64) -> F32:
    """Means (k, d) of the rows (n, d) of each window."""
    sums = np.zeros((int(window[-1]) + 1, values.shape[1]))
    np.add.at(sums, window, values)
    return (sums / np.bincount(window)[:, None]).astype(np.float32)


def likely_revisits(means: F32, line_windows: int, similarity: float) -> Bool:
    """Pairs of windows (k, k) on a stretch that sounds like another one.

    One window is similar to many places, a sequence to few: `similarity` is asked of the mean over
    `line_windows` windows that advance together, or one forward and one back.
    """
    scores = means @ means.T
    along = _mean_along(scores, line_windows)
    back = _mean_along(scores[:, ::-1], line_windows)[:, ::-1]
    return np.asarray(np.maximum(along, back) >= similarity, dtype=bool)


def beside(pairs: Bool, windows: int) -> Bool:
    """`pairs` (k, k) and those at most `windows` windows from one of them, on either side."""
    return np.asarray(maximum_filter(pairs, size=2 * windows + 1), dtype=bool)


def _mean_along(scores: F32, length: int) -> F32:
    """Mean of `length` elements along the diagonal about each element, fewer at the border."""
    half, size = length // 2, scores.shape
    total, count = np.zeros(size, dtype=np.float32), np.zeros(size, dtype=np.float32)
    for shift in range(-half, half + 1):
        here = tuple(slice(max(-shift, 0), max(extent - max(shift, 0), 0)) for extent in size)
        there = tuple(slice(max(shift, 0), max(extent + min(shift, 0), 0)) for extent in size)
        total[here] += scores[there]
        count[here] += 1
    return total / count
