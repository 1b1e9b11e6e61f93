"""How long `elfslam map` takes for a walk with sound, and how much memory.

Usage, from the root of the project:

    python -m studies.benchmarks.mapping_time FOLDER [--minutes 10]

The walk is simulated in the concourse and kept in FOLDER for the next time. Seconds are those of
the whole command, the start of the interpreter included.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from pathlib import Path

from elfslam.data.recordings import write_recording
from elfslam.world.simulate import load_world, simulate

ROUND_S = 108.0
SEED = 100


def main() -> None:
    """Print seconds, processor seconds and peak memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--minutes", type=float, default=10.0)
    known = parser.parse_args()
    walk = known.folder / f"walk-{known.minutes:g}"
    if not walk.is_dir():
        rounds = max(round(60 * known.minutes / ROUND_S), 1)
        write_recording(simulate(load_world("concourse"), SEED, rounds=rounds)[0], walk)
    out = known.folder / "run"
    command = [sys.executable, "-c", "from elfslam.cli import main; main()", "map"]
    start = time.perf_counter()
    subprocess.run([*command, str(walk), str(out), "--force"], check=True)
    seconds = time.perf_counter() - start
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"{seconds:.1f} s, {used.ru_utime + used.ru_stime:.1f} s of processor, "
        f"{used.ru_maxrss / 2**20:.2f} GiB at most"
    )
    print((out / "timings.json").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
