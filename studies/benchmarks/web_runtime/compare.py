"""Does an encoder file give in onnxruntime-web what it gives in onnxruntime?

Usage, from the root of the project, after `npm ci` in this folder (`make web-check` does both):

    python -m studies.benchmarks.web_runtime.compare [--encoder compact]

The first echoes of a simulated walk are embedded by both, one echo alone and 64 at once, on one
thread. Exit code 1 where an element differs by more than 1e-4. Milliseconds are wall clock, the
fastest of five.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnxruntime

from elfslam.app.settings import Settings
from elfslam.base.arrays import F32
from elfslam.stages.feature import OnnxEncoder, load_encoder
from elfslam.world.simulate import load_world
from studies.cached import extract_echoes, simulate

COUNTS = (1, 64)
MOST_DIFFERENCE = 1e-4
REPEATS = 5
HERE = Path(__file__).parent


def by_web(content: bytes, samples: F32) -> tuple[dict[int, F32], dict[int, float]]:
    """ELFs and milliseconds of onnxruntime-web under node, by the number of echoes at once."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "encoder.onnx").write_bytes(content)
        samples.astype("<f4").tofile(folder / "samples.f32")
        arguments = [str(folder / "encoder.onnx"), name, *map(str, COUNTS)]
        done = subprocess.run(
            ["node", str(HERE / "check.mjs"), *arguments], check=True, stdout=subprocess.PIPE
        )
        elf = {k: np.fromfile(folder / f"elf_{k}.f32", "<f4").reshape(k, -1) for k in COUNTS}
    return elf, {int(k): ms for k, ms in json.loads(done.stdout).items()}


def by_python(content: bytes, samples: F32) -> tuple[dict[int, F32], dict[int, float]]:
    """The same of onnxruntime."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    elf, fastest_ms = {}, {}
    for count in COUNTS:
        given = {"samples": samples[:count]}
        (elf[count],) = session.run(["elf"], given)
        seconds = []
        for _ in range(REPEATS):
            start = time.perf_counter()
            session.run(["elf"], given)
            seconds.append(time.perf_counter() - start)
        fastest_ms[count] = 1000 * min(seconds)
    return elf, fastest_ms


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--encoder", default="compact")
    encoder = load_encoder(parser.parse_args().encoder)
    assert isinstance(encoder, OnnxEncoder), "name an ONNX file"
    recording, _ = simulate(load_world("studio"), 100, rounds=1)
    samples = extract_echoes(recording, Settings()).samples[: max(COUNTS)]
    (web, web_ms), (python, python_ms) = (
        by(encoder.content, samples) for by in (by_web, by_python)
    )
    worst = 0.0
    for count in COUNTS:
        difference = float(np.abs(web[count] - python[count]).max())
        worst = max(worst, difference)
        print(
            f"{count:3} at once: largest difference {difference:.1e}; "
            f"{web_ms[count] / count:.2f} ms per echo in the browser's runtime, "
            f"{python_ms[count] / count:.2f} ms in onnxruntime"
        )
    agree = worst <= MOST_DIFFERENCE
    print(f"encoder {encoder.identity}: {'the same' if agree else 'NOT THE SAME'} to 1e-4")
    return 0 if agree else 1


if __name__ == "__main__":
    sys.exit(main())
