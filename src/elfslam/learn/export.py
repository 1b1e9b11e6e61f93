"""Encoders as ONNX files: one graph from raw aligned samples to the ELF."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import nn

from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE
from elfslam.line.feature import BINS


def export_encoder(network: nn.Module, path: Path) -> None:
    """Write `network` to `path`.

    Input `samples` (n, 2352), optional input `device_log_spectrum` (12) that defaults to zeros,
    output `elf` (n, 128).
    """
    model = onnx.load_model_from_string(_traced(network))
    model.graph.initializer.append(
        numpy_helper.from_array(np.zeros(BINS, dtype=np.float32), "device_log_spectrum")
    )
    model.graph.output[0].type.tensor_type.shape.dim[1].dim_value = ELF_SIZE
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_bytes(model.SerializeToString())
    partial.replace(path)


def _traced(network: nn.Module) -> bytes:
    buffer = io.BytesIO()
    example = torch.randn(2, ECHO_SAMPLES), torch.zeros(BINS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network.eval(),
            example,
            buffer,  # type: ignore[arg-type]
            input_names=["samples", "device_log_spectrum"],
            output_names=["elf"],
            dynamic_axes={"samples": {0: "n"}, "elf": {0: "n"}},
            opset_version=17,
            dynamo=False,
        )
    return buffer.getvalue()
