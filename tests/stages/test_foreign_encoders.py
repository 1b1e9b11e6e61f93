"""Encoders from others may do anything while they run: they are stopped, and said so in a line."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from foreign_encoders import ALLOCATES, FAILS, GOOD, GROWS, LOOPS, OTHERS, foreign_encoder
from onnx import helper

from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE
from elfslam.stages import feature

ROWS = np.random.default_rng(0).standard_normal((3, ECHO_SAMPLES)).astype(np.float32)
PEAK = """
import pathlib, sys
import numpy as np
from elfslam.stages.feature import load_encoder
try:
    load_encoder(sys.argv[1]).embed(np.ones((3, 2352), dtype=np.float32))
except Exception as error:
    status = pathlib.Path("/proc/self/status").read_text()  # what a parent held does not count
    print(type(error).__name__, int(status.split("VmHWM:")[1].split()[0]) * 1024)
"""


def test_the_graph_that_is_spoilt_is_a_good_one() -> None:
    made = feature.OnnxEncoder(foreign_encoder(*GOOD), "good").embed(ROWS)
    cut = ROWS[:, :ELF_SIZE]
    np.testing.assert_allclose(made, cut / np.linalg.norm(cut, axis=1)[:, None], atol=1e-6)


@pytest.mark.parametrize(
    ("nodes", "why"),
    [
        (LOOPS, "takes more than 0.2 s"),
        (FAILS, "fails"),
        *[(nodes, "gives something else") for nodes in OTHERS.values()],
    ],
    ids=["loops", "fails", *OTHERS],
)
def test_what_misbehaves_is_refused(nodes: tuple[onnx.NodeProto, ...], why: str) -> None:
    encoder = feature.OnnxEncoder(foreign_encoder(*nodes), "bad", batch_s=0.2)
    with pytest.raises(InputError, match=f"encoder bad: {why}") as refused:
        encoder.embed(ROWS)
    assert "\n" not in str(refused.value)


def test_the_time_of_a_batch_is_counted_in_waits_so_that_a_halted_machine_refuses_nothing() -> None:
    class Halted(threading.Event):
        waits = 0

        def wait(self, timeout: float | None = None) -> bool:
            Halted.waits += 1
            return False

    options = onnxruntime.RunOptions()
    feature._stop_late(options, Halted(), 3.0)
    assert options.terminate
    assert Halted.waits == feature.BATCH_TICKS
    done = threading.Event()
    done.set()
    fresh = onnxruntime.RunOptions()
    feature._stop_late(fresh, done, 3.0)
    assert not fresh.terminate


@pytest.mark.parametrize("nodes", [GROWS, ALLOCATES], ids=["grows", "allocates"])
def test_who_takes_all_memory_gets_some(tmp_path: Path, nodes: tuple[onnx.NodeProto, ...]) -> None:
    (tmp_path / "bad.onnx").write_bytes(foreign_encoder(*nodes))
    command = [sys.executable, "-c", PEAK, str(tmp_path / "bad.onnx")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    kind, peak_bytes = done.stdout.split()
    assert (kind, done.stderr) == ("InputError", "")
    assert int(peak_bytes) < feature.MOST_RUN_BYTES + 512 * 2**20


@pytest.mark.parametrize("kind", [onnx.TensorProto.DOUBLE, onnx.TensorProto.STRING])
def test_numbers_of_another_kind_are_refused(kind: int) -> None:
    cast = helper.make_node("Cast", ["unit"], ["elf"], to=kind)
    with pytest.raises(InputError, match="something else"):
        feature.OnnxEncoder(foreign_encoder(cast, output=kind), "bad").embed(ROWS)


def test_an_encoder_that_is_no_plain_file_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "mine.onnx")
    with pytest.raises(InputError, match="no ordinary file"):
        feature.load_encoder(str(tmp_path / "mine.onnx"))
