"""ONNX graphs that look like encoders and misbehave while they run."""

import numpy as np
import onnx
from onnx import helper, numpy_helper

from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE

ROWS_OF_ONE = [
    helper.make_node("Slice", ["samples", "zero", "size", "one"], ["cut"]),
    helper.make_node("LpNormalization", ["cut"], ["unit"], axis=1, p=2),
]
INT64 = {"zero": [0], "one": [1], "size": [ELF_SIZE], "half": [ELF_SIZE // 2], "huge": [10**9]}


def foreign_encoder(*nodes: onnx.NodeProto, output: int = onnx.TensorProto.FLOAT) -> bytes:
    """A graph that looks like an encoder and has `unit`, vectors as they should be, to spoil."""
    constants = [numpy_helper.from_array(np.array(INT64[name]), name) for name in INT64]
    constants += [
        numpy_helper.from_array(np.array(2**62), "forever"),
        numpy_helper.from_array(np.array(True), "true"),
        numpy_helper.from_array(np.array([np.nan], dtype=np.float32), "nan"),
    ]
    graph = helper.make_graph(
        [*ROWS_OF_ONE, *nodes],
        "foreign",
        [helper.make_tensor_value_info("samples", onnx.TensorProto.FLOAT, ["n", ECHO_SAMPLES])],
        [helper.make_tensor_value_info("elf", output, None)],
        constants,
    )
    opset = [helper.make_opsetid("", 17)]
    return bytes(helper.make_model(graph, opset_imports=opset, ir_version=8).SerializeToString())


def endless(step: onnx.NodeProto) -> onnx.NodeProto:
    """A loop that never ends: `step` from x_in to x_out."""
    boolean, number = onnx.TensorProto.BOOL, onnx.TensorProto.FLOAT
    body = helper.make_graph(
        [helper.make_node("Identity", ["go_in"], ["go_out"]), step],
        "body",
        [
            helper.make_tensor_value_info("k", onnx.TensorProto.INT64, []),
            helper.make_tensor_value_info("go_in", boolean, []),
            helper.make_tensor_value_info("x_in", number, None),
        ],
        [
            helper.make_tensor_value_info("go_out", boolean, []),
            helper.make_tensor_value_info("x_out", number, None),
        ],
    )
    return helper.make_node("Loop", ["forever", "true", "unit"], ["elf"], body=body)


def _node(kind: str, *given: str, to: str = "elf", **more: object) -> onnx.NodeProto:
    return helper.make_node(kind, list(given), [to], **more)


GOOD = (_node("Identity", "unit"),)
LOOPS = (endless(_node("Identity", "x_in", to="x_out")),)
GROWS = (endless(_node("Concat", "x_in", "x_in", to="x_out", axis=0)),)
ALLOCATES = (
    _node("Expand", "nan", "huge", to="large"),
    _node("ReduceSum", "large", to="sum", keepdims=0),
    _node("Add", "unit", "sum"),
)
FAILS = (_node("Reshape", "unit", "huge"),)
OTHERS = {
    "nan": (_node("Add", "unit", "nan"),),
    "long": (_node("Add", "unit", "unit"),),
    "narrow": (_node("Slice", "unit", "zero", "half", "one"),),
    "many": (_node("Concat", "unit", "unit", axis=0),),
    "number": (_node("ReduceSum", "unit", keepdims=0),),
}
"""Those that give something else than a unit vector for each echo."""
