"""The shipped encoder: the compact network trained on echoes from random simulated rooms."""

from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from elfslam import __version__
from elfslam.app.workers import Workers, open_workers
from elfslam.base.arrays import F64, I64
from elfslam.base.card import Card, Pretraining, training_facts
from elfslam.base.errors import ParameterError, StoreError
from elfslam.base.values import EchoPairs
from elfslam.data.atomic_files import new_file
from elfslam.learn.network import CompactEncoder, with_components
from elfslam.learn.onnx_files import export_encoder
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.pretrain import NETWORKS, PairsOf, Pretrained, pretrain
from elfslam.learn.resumable import Batch, Stream, TrainingStep, prefetched
from elfslam.scoring.charts import loss_figure
from elfslam.scoring.page import Page, Panel, facts_table, save_page
from elfslam.world.circumstances import DIFFUSE, ENGINES
from elfslam.world.echo_pairs import echo_pairs

ABOUT = """\
ELF encoder: turns an echo trace into a unit vector; two traces of one place have a high cosine
Data: simulated echoes of random furnished rooms and random phones; no real room, no person
Input: samples (n, 2352), float32 at 44.1 kHz, from 11 ms after the direct arrival of the chirp
Output: elf (n, 128), unit rows, each from its own trace alone
Limits: made for the 10 ms chirp from 15 to 20 kHz; one trace says little, so compare means over a \
footstep; places that look alike after half a turn of the room sound alike
"""
BLOCK_STEPS = 20
"""Steps that make one row of the table of losses."""
LOSS_NOTE = f"Each step, and the mean of every {BLOCK_STEPS}. Batches differ, so steps do too."


def pretrain_on_simulated_echoes(
    out: Path,
    parameters: PretrainParameters,
    *,
    seed: int,
    announce: Callable[[str, float | None], None],
    metrics: Mapping[str, float] | None = None,
    on: str | None = None,
    overwrite: bool = False,
) -> float:
    """Train, write the ONNX file `out`, and give the mean loss over the last tenth of the steps.

    The file carries its card, `metrics` in it; beside it come to lie the losses as a table and as
    a page. The checkpoint lies there until the training is done, so that a killed run goes on.
    `on` says who makes the echoes, as `open_workers` has it. Raises StoreError,
    ParameterError or InputError before anything is made.
    """
    _check(out, parameters)

    def report(progress: TrainingStep) -> None:
        share = progress.step / parameters.steps
        announce(f"step {progress.step} of {parameters.steps}, loss {progress.loss:.3f}", share)

    checkpoint = out.with_suffix(".checkpoint")
    with _new_files(out, overwrite=overwrite) as (encoder, table, page):
        made = _trained(parameters, report, seed=seed, checkpoint=checkpoint, on=on)
        write_losses(table, page, out.name, made.losses, parameters, seed)
        card = card_of(made, parameters, seed, metrics or {})
        export_encoder(made.network, encoder, card=card)
    checkpoint.unlink(missing_ok=True)
    return last_loss(made.losses)


@contextmanager
def _new_files(out: Path, *, overwrite: bool) -> Iterator[tuple[Path, ...]]:
    """Where the encoder, the table of losses and their page are to be written."""
    with ExitStack() as stack:
        yield tuple(
            stack.enter_context(new_file(out.with_suffix(suffix), overwrite=overwrite))
            for suffix in (".onnx", ".losses.csv", ".losses.html")
        )


def pairs_in(parameters: PretrainParameters, seed: int, engine: str = ENGINES[0]) -> PairsOf:
    """The batch of each step, which depends on these and the step alone, wherever it is made."""
    return partial(
        step_pairs, seed=seed, pairs=parameters.pairs, rooms=parameters.rooms, engine=engine
    )


def step_pairs(step: int, *, seed: int, pairs: int, rooms: int, engine: str) -> EchoPairs:
    """Echo pairs of a step."""
    return echo_pairs(np.random.default_rng([seed, step]), pairs, rooms, engine)


def _trained(
    parameters: PretrainParameters,
    report: Callable[[TrainingStep], None],
    *,
    seed: int,
    checkpoint: Path,
    on: str | None,
) -> Pretrained:
    with open_stream(on) as stream:
        made = pretrain(
            pairs_in(parameters, seed), parameters, seed=seed, checkpoint=checkpoint,
            report=report, stream=stream,
        )  # fmt: skip
        if isinstance(made.network, CompactEncoder):
            _give_components(made.network, stream, parameters, seed)
        return made


def _give_components(
    network: CompactEncoder, stream: Stream, parameters: PretrainParameters, seed: int
) -> None:
    """Fit the network's components, if any are wanted, on rooms that ring as measured ones do."""
    first, more = parameters.steps, parameters.component_batches
    if more:
        batches = stream(pairs_in(parameters, seed, DIFFUSE), first, first + more)
        with_components(network, (batch for _, batch in batches))


@contextmanager
def open_stream(on: str | None) -> Iterator[Stream]:
    """Who makes the batches: another thread of this process, or the workers that `on` names."""
    if on is None:
        yield prefetched
        return
    with open_workers(on) as workers:
        yield partial(_made_by, workers)


def _made_by(
    workers: Workers, batch_of: Callable[[int], Batch], first: int, last: int
) -> Generator[tuple[int, Batch]]:
    steps = range(first, last)
    with closing(workers.in_order(batch_of, steps)) as batches:
        yield from zip(steps, batches, strict=True)


def card_of(
    made: Pretrained, parameters: PretrainParameters, seed: int, metrics: Mapping[str, float]
) -> Card:
    """What the encoder file says of itself; nothing in it depends on the day."""
    how = Pretraining(
        software=f"elfslam {__version__}",
        seed=seed,
        echoes=2 * parameters.pairs * parameters.steps,
        arithmetic=made.arithmetic,
        loss=round(last_loss(made.losses), 3),
        **training_facts(parameters),
    )
    return Card(ABOUT, how, metrics=metrics)


def last_loss(losses: F64) -> float:
    """The mean over the last tenth of the steps."""
    return float(np.mean(losses[-max(len(losses) // 10, 1) :]))


def write_losses(
    table: Path, page: Path, name: str, losses: F64, parameters: PretrainParameters, seed: int
) -> None:
    """The loss over the steps of learning what is called `name`, as a CSV and as a page."""
    step, mean = block_means(losses, BLOCK_STEPS)
    np.savetxt(
        table, np.column_stack([step, mean]), fmt=["%d", "%.5f"], delimiter=",",
        header="step,loss", comments="",
    )  # fmt: skip
    shown = Page(
        title=f"Learning {name}",
        subtitle=f"Pairs of simulated echoes, seed {seed}",
        panels=[Panel("Loss", loss_figure(losses, step, mean), LOSS_NOTE, wide=True)],
        tiles={
            "mean loss of the last tenth": f"{last_loss(losses):.3f}",
            "loss of the first step": f"{losses[0]:.3f}",
            "steps": f"{len(losses):,}",
            "echoes": f"{2 * parameters.pairs * len(losses):,}",
        },
        details={"Parameters": facts_table(asdict(parameters))},
    )
    save_page(page, shown)


def block_means(losses: F64, size: int) -> tuple[I64, F64]:
    """The last step of each block of `size` steps, counted from 1, and the mean loss over it."""
    starts = np.arange(0, len(losses), size)
    ends = np.minimum(starts + size, len(losses))
    return ends, np.add.reduceat(losses, starts) / (ends - starts)


def _check(out: Path, parameters: PretrainParameters) -> None:
    if out.suffix != ".onnx":
        raise StoreError(f"{out}: wanted a name that ends in .onnx; rename it")
    if parameters.network not in NETWORKS:
        raise ParameterError(
            f"pretrain.network: wanted {' or '.join(NETWORKS)}, got {parameters.network!r}; "
            "correct it"
        )
    if parameters.pairs % parameters.rooms:
        raise ParameterError(
            f"pretrain.pairs: wanted a multiple of pretrain.rooms ({parameters.rooms}), "
            f"got {parameters.pairs}; change one"
        )
