"""Training the shipped encoder, in miniature; `elfslam pretrain` by several."""

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from torch import nn

from elfslam.app import simulated_training as pretraining
from elfslam.app.simulated_training import open_stream, pairs_in
from elfslam.base.errors import ParameterError, StoreError
from elfslam.base.parameters import digest
from elfslam.base.values import EchoPairs, silent
from elfslam.cli.app import run
from elfslam.learn.network import CompactEncoder
from elfslam.learn.onnx_files import network_of
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.pretrain import PairsOf, Pretrained
from elfslam.stages.feature import SHIPPED_ENCODER, load_encoder, read_card
from elfslam.world.circumstances import DIFFUSE

SMALL = PretrainParameters(steps=3, pairs=8, rooms=2, width=4, warmup_steps=1, checkpoint_steps=2)


@pytest.mark.real
def test_the_same_seed_trains_the_same_encoder(tmp_path: Path) -> None:
    shares: list[float | None] = []
    for name in ("one", "two"):
        file = tmp_path / f"{name}.onnx"
        note = {"announce": lambda what, share: shares.append(share)}
        loss = pretraining.pretrain_on_simulated_echoes(file, SMALL, seed=3, **note)
        assert loss > 0
    one, two = (load_encoder(str(tmp_path / f"{name}.onnx")) for name in ("one", "two"))
    assert one.identity == two.identity
    assert shares[:3] == pytest.approx([1 / 3, 2 / 3, 1.0])
    made = {name: tmp_path / f"one.{name}" for name in ("onnx", "losses.csv", "losses.html")}
    assert {file.name for file in tmp_path.glob("one*")} == {file.name for file in made.values()}
    assert made["losses.csv"].read_bytes() == (tmp_path / "two.losses.csv").read_bytes()
    card = read_card(str(made["onnx"]))
    assert card.pretraining.seed == 3
    assert card.pretraining.echoes == 2 * 8 * 3
    assert card.pretraining.loss == round(loss, 3)
    assert PretrainParameters(**card.pretraining.parameters) == SMALL
    assert card.pretraining.parameters_digest == digest(SMALL)
    (row,) = np.atleast_2d(np.loadtxt(made["losses.csv"], delimiter=",", skiprows=1))
    assert row[0] == 3
    assert "loss of the first step" in made["losses.html"].read_text()
    assert made["losses.html"].stat().st_size < 500_000


@pytest.mark.parametrize("count", [0, 2])
def test_the_components_are_fitted_on_diffuse_batches_behind_the_others(count: int) -> None:
    """As many as the parameters say, none of which was trained on; without any there are none."""
    asked: list[tuple[object, int, int]] = []

    def stream(pairs_of: PairsOf, first: int, last: int) -> Iterator[tuple[int, EchoPairs]]:
        asked.append((pairs_of.keywords["engine"], first, last))
        yield from ((step, pairs_of(step)) for step in range(first, last))

    known = replace(SMALL, component_batches=count)
    network = CompactEncoder(4).eval()
    pretraining._give_components(network, stream, known, 0)
    assert (network.components is not None) == (count > 0)
    assert asked == ([(DIFFUSE, 3, 5)] if count else [])


def test_the_shipped_encoder_has_components() -> None:
    assert network_of(SHIPPED_ENCODER.read_bytes()).components is not None


def test_losses_are_averaged_block_by_block() -> None:
    step, mean = pretraining.block_means(np.arange(1.0, 8.0), 3)
    assert step.tolist() == [3, 6, 7]
    assert mean.tolist() == [2.0, 5.0, 7.0]


def test_the_last_tenth_counts() -> None:
    assert pretraining.last_loss(np.arange(40.0)) == np.mean([36, 37, 38, 39])
    assert pretraining.last_loss(np.array([5.0, 2.0])) == 2.0


def test_figures_of_the_caller_stand_on_the_card() -> None:
    made = Pretrained(nn.Identity(), np.array([2.0, 1.0]), "float32")
    one, two = (pretraining.card_of(made, SMALL, 0, metrics) for metrics in ({}, {"recall": 0.5}))
    assert two == replace(one, metrics={"recall": 0.5})
    assert one.text.count("\n") == len(one.text.splitlines())
    assert all(": " in line for line in one.text.splitlines())


def never(*arguments: object, **named: object) -> None:
    raise AssertionError("the training must not start")


@pytest.mark.parametrize(
    ("name", "parameters", "error", "words"),
    [
        ("new/one.onnx", replace(SMALL, pairs=9), ParameterError, "multiple of pretrain.rooms"),
        ("new/one.onnx", replace(SMALL, network="vgg"), ParameterError, "compact or resnet18"),
        ("new/one.checkpoint", SMALL, StoreError, r"ends in \.onnx"),
    ],
)
def test_what_cannot_be_trained_is_refused_before_anything_is_made(
    name: str,
    parameters: PretrainParameters,
    error: type[Exception],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pretraining, "pretrain", never)
    with pytest.raises(error, match=words):
        pretraining.pretrain_on_simulated_echoes(
            tmp_path / name, parameters, seed=0, announce=silent
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("checkpoint", "left"), [(False, []), (True, ["new", "deep", "a.pt"])])
def test_a_training_that_fails_leaves_a_folder_only_for_its_checkpoint(
    checkpoint: bool, left: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "new" / "deep"

    def fail(*arguments: object, **named: object) -> None:
        assert folder.is_dir()
        if checkpoint:
            (folder / "a.pt").touch()
        raise RuntimeError("planted")

    monkeypatch.setattr(pretraining, "pretrain", fail)
    file = folder / "one.onnx"
    with pytest.raises(RuntimeError, match="planted"):
        pretraining.pretrain_on_simulated_echoes(file, SMALL, seed=0, announce=silent)
    assert [path.name for path in sorted(tmp_path.rglob("*"))] == left


def test_the_shipped_encoder_was_trained_as_the_defaults_say() -> None:
    card = read_card("compact")
    assert card.pretraining.parameters == asdict(PretrainParameters())
    assert card.pretraining.parameters_digest == digest(PretrainParameters())
    assert card.text == pretraining.ABOUT


TINY = ("steps=2", "pairs=4", "rooms=2", "width=4", "warmup_steps=1")
SETTINGS = [word for setting in TINY for word in ("--set", f"pretrain.{setting}")]


def command(out: Path, *options: str) -> int:
    return run(["pretrain", str(out), *SETTINGS, *options])


def test_nobody_to_work_for_it_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(tmp_path / "new" / "one.onnx", "--on", "nobody") == 2
    said = capsys.readouterr().err.strip()
    assert "on nobody: wanted a number of processes, ray or ray://" in said
    assert "\n" not in said
    assert list(tmp_path.iterdir()) == []


def test_the_echoes_of_a_step_are_the_same_wherever_they_are_made() -> None:
    pairs_of = pairs_in(PretrainParameters(pairs=4, rooms=2), 7)
    with open_stream("1") as here, open_stream("2") as elsewhere:
        streams = [list(stream(pairs_of, 3, 6)) for stream in (here, elsewhere)]
    for step, batch in streams[1]:
        assert np.array_equal(batch.first, pairs_of(step).first)
        assert np.array_equal(batch.xy_m, pairs_of(step).xy_m)
    assert [step for step, _ in streams[0]] == [step for step, _ in streams[1]] == [3, 4, 5]
    assert not np.array_equal(streams[0][0][1].first, streams[0][1][1].first)
