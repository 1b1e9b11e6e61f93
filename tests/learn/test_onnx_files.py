"""Encoders as ONNX: the same numbers, any number of rows."""

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from elfslam.base.arrays import F32
from elfslam.base.card import Card, Pretraining, metadata_of, training_facts
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES
from elfslam.learn.network import CompactEncoder
from elfslam.learn.onnx_files import encoder_content, export_encoder, with_metrics
from elfslam.learn.parameters import PretrainParameters
from elfslam.stages.feature import OnnxEncoder, load_encoder, read_card

MOST_BYTES = 2_000_000


def traces(count: int, seed: int = 0) -> F32:
    noise = np.random.default_rng(seed).standard_normal((count, ECHO_SAMPLES))
    return np.asarray(0.01 * noise, dtype=np.float32)


@pytest.fixture(scope="module")
def network() -> CompactEncoder:
    torch.manual_seed(0)
    made = CompactEncoder(24)
    with torch.no_grad():
        made.train()(torch.from_numpy(traces(32)))
    return made.eval()


@pytest.fixture(scope="module")
def file(network: CompactEncoder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights") / "new" / "encoder.onnx"
    export_encoder(network, path)
    return path


def by_torch(network: CompactEncoder, samples: F32) -> F32:
    with torch.no_grad():
        return network(torch.from_numpy(samples)).numpy()


def test_the_file_is_whole_small_and_by_the_book(file: Path) -> None:
    onnx.checker.check_model(onnx.load(file), full_check=True)
    assert file.stat().st_size < MOST_BYTES
    assert [path.name for path in file.parent.iterdir()] == ["encoder.onnx"]


def test_names_and_shapes_are_those_the_line_expects(file: Path) -> None:
    graph = onnx.load(file).graph
    shapes = {
        item.name: [d.dim_param or d.dim_value for d in item.type.tensor_type.shape.dim]
        for item in [*graph.input, *graph.output]
    }
    assert shapes["samples"] == ["n", ECHO_SAMPLES]
    assert shapes["elf"][0] == "n"
    assert len(shapes) == 2


def test_the_line_reads_it(network: CompactEncoder, file: Path) -> None:
    samples = traces(300, seed=2)
    encoder = load_encoder(str(file))
    np.testing.assert_allclose(encoder.embed(samples), by_torch(network, samples), atol=1e-5)


def test_one_network_gives_one_file(network: CompactEncoder, file: Path, tmp_path: Path) -> None:
    """So that the identity of an encoder, a digest of its file, means its weights."""
    export_encoder(network, tmp_path / "again.onnx")
    assert (tmp_path / "again.onnx").read_bytes() == file.read_bytes()


def test_a_network_in_training_is_exported_as_it_will_be_used(
    network: CompactEncoder, file: Path, tmp_path: Path
) -> None:
    export_encoder(network.train(), tmp_path / "again.onnx")
    network.eval()
    assert (tmp_path / "again.onnx").read_bytes() == file.read_bytes()


def card(seed: int = 3) -> Card:
    facts = training_facts(PretrainParameters())
    how = Pretraining("elfslam 0", seed, 1024, "float32", 1.5, **facts)
    return Card("Encoder: of a test", how, metrics={"recall": 0.75})


def test_the_file_carries_its_card(network: CompactEncoder, file: Path, tmp_path: Path) -> None:
    path = tmp_path / "carded.onnx"
    export_encoder(network, path, card=card())
    assert read_card(str(path)) == card()
    props = {item.key: item.value for item in onnx.load(path).metadata_props}
    assert props == metadata_of(card()), "any program that reads ONNX finds it"
    samples = traces(5, seed=3)
    with_card, without = (load_encoder(str(name)) for name in (path, file))
    assert (with_card.embed(samples) == without.embed(samples)).all()
    assert onnx.load(path).graph == onnx.load(file).graph
    assert read_card(str(file)) is None


def test_figures_go_on_the_card_and_change_nothing_else(network: CompactEncoder) -> None:
    plain = encoder_content(network, Card("A line.", metrics={"old": 1.0}))
    told = OnnxEncoder(with_metrics(plain, {"recall": 0.75}), "told")
    assert told.card == Card("A line.", metrics={"recall": 0.75})
    heard = traces(3)
    np.testing.assert_array_equal(told.embed(heard), OnnxEncoder(plain, "plain").embed(heard))


@pytest.mark.parametrize("content", [b"", b"no graph"])
def test_no_figures_go_on_what_is_no_encoder(content: bytes) -> None:
    with pytest.raises(InputError, match=r"wanted an ONNX file|carries no card"):
        with_metrics(content, {})


def test_no_figures_go_where_no_card_is(network: CompactEncoder) -> None:
    with pytest.raises(InputError, match="carries no card"):
        with_metrics(encoder_content(network), {})
