"""Encoders as ONNX files, and back: one graph from raw aligned samples to the ELF."""

import io
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import onnx
import torch
from onnx import numpy_helper
from torch import nn

from elfslam.base.arrays import F32
from elfslam.base.card import Card, card_in, metadata_of
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE
from elfslam.learn.network import CompactEncoder, Components

COMPONENTS = "components."


def export_encoder(network: nn.Module, path: Path, *, card: Card | None = None) -> None:
    """Write `network` to `path`, with its `card` as the file's metadata. Raises OSError.

    Input `samples` (n, 2352), output `elf` (n, 128). Same network and card, same bytes.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encoder_content(network, card))


def encoder_content(network: nn.Module, card: Card | None = None) -> bytes:
    """`network` as the content of an encoder file, see `export_encoder`."""
    model = onnx.load_model_from_string(_traced(network))
    model.graph.output[0].type.tensor_type.shape.dim[1].dim_value = ELF_SIZE
    if card is not None:
        onnx.helper.set_model_props(model, metadata_of(card))
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def with_metrics(content: bytes, metrics: Mapping[str, float]) -> bytes:
    """The same encoder file with these figures on its card, older ones replaced.

    Raises InputError where the file is no ONNX or has no card.
    """
    try:
        model = onnx.load_model_from_string(content)
    except Exception as cause:  # protobuf raises many types
        raise InputError("encoder: wanted an ONNX file, got another; name one") from cause
    card = card_in({entry.key: entry.value for entry in model.metadata_props})
    if card is None:
        raise InputError("encoder: carries no card to write figures on; train it with pretrain")
    onnx.helper.set_model_props(model, metadata_of(replace(card, metrics=metrics)))
    return bytes(model.SerializeToString())


def network_of(content: bytes) -> CompactEncoder:
    """The network in the encoder file `content`, ready to be trained further.

    The file's convolutions have taken in the statistics behind them, so those of the network are
    zero and one: what it computes is the same to rounding. Raises InputError for a file of
    another network.
    """
    try:
        return _rebuilt(onnx.load_model_from_string(content).graph)
    except Exception as cause:  # protobuf, numpy and torch raise many types for a foreign graph
        raise InputError(
            "encoder: wanted the compact network of `elfslam pretrain`, got another graph; "
            "name a file that it wrote"
        ) from cause


def _rebuilt(graph: onnx.GraphProto) -> CompactEncoder:
    known = {item.name: numpy_helper.to_array(item) for item in graph.initializer}
    folded = [node for node in graph.node if node.op_type == "Conv" and len(node.input) == 3]
    network = CompactEncoder(len(known[folded[0].input[1]])).eval()
    _load(network.head, "head.", known)
    if any(name.startswith(COMPONENTS) for name in known):
        network.components = Components()
        _load(network.components, COMPONENTS, known)
    modules = list(network.body.modules())
    convolutions = [module for module in modules if isinstance(module, nn.Conv2d)]
    norms = [module for module in modules if isinstance(module, nn.BatchNorm2d)]
    for node, convolution, norm in zip(folded, convolutions, norms, strict=True):
        _unfold(known[node.input[1]], known[node.input[2]], convolution, norm)
    return network


def _load(module: nn.Module, prefix: str, known: Mapping[str, F32]) -> None:
    """The weights of a part of the network, by their names in the file."""
    module.load_state_dict(
        {
            name.removeprefix(prefix): torch.tensor(value)
            for name, value in known.items()
            if name.startswith(prefix)
        }
    )


def _unfold(weight: F32, bias: F32, convolution: nn.Conv2d, norm: nn.BatchNorm2d) -> None:
    with torch.no_grad():
        convolution.weight.copy_(torch.tensor(weight))
        norm.weight.fill_((1 + norm.eps) ** 0.5)
        norm.bias.copy_(torch.tensor(bias))


def _traced(network: nn.Module) -> bytes:
    buffer = io.BytesIO()
    example = torch.randn(2, ECHO_SAMPLES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network.eval(),
            (example,),
            buffer,  # type: ignore[arg-type]
            input_names=["samples"],
            output_names=["elf"],
            dynamic_axes={"samples": {0: "n"}, "elf": {0: "n"}},
            opset_version=17,
            dynamo=False,
        )
    return buffer.getvalue()
