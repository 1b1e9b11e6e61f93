"""What one building costs: seconds of processor and bytes for walks, maps, merges and fixes.

Usage, from the root of the project:

    python -m studies.benchmarks.building_costs FOLDER

Walks of about 1, 5 and 10 minutes with sound are simulated (development worlds) and kept in FOLDER.
Seconds are of processor, the start of the interpreter included; it is also measured alone.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from pathlib import Path

from elfslam.app.console import print_rows, say
from elfslam.app.settings import Settings
from elfslam.base.choices import Mode
from elfslam.data.fixes_files import write_fixes
from elfslam.data.map_files import read_map
from elfslam.data.recordings import read_recording, write_recording
from elfslam.line.feature import load_encoder
from elfslam.slam import pipeline as slam
from elfslam.world.simulate import load_world, simulate

WALKS = {
    "1 min": ("lounge", 4, 100),
    "5 min": ("concourse", 3, 100),
    "10 min": ("concourse", 6, 100),
}
AGAIN = ("again", ("concourse", 3, 101))
"""Merged with the walk of 5 minutes, and located in its map."""
COMMAND = (sys.executable, "-c", "from elfslam.cli import main; main()")
Row = dict[str, object]


def main() -> None:
    """Print a row per piece of work."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    rows: list[Row] = [{**work("starting a command", ["--help"]), **sizes(None, None)}]
    for name, told in {**WALKS, AGAIN[0]: AGAIN[1]}.items():
        walk = folder / name.replace(" ", "-")
        seconds = simulated(walk, told)
        run = folder / f"{walk.name}-run"
        done = work(f"map {seconds:.0f} s", ["map", str(walk), str(run), "--force"])
        rows.append({**done, **sizes(walk, run)})
        say(str(rows[-1]))
    runs = [folder / "5-min-run", folder / "again-run"]
    merged = work(
        "merge two of 5 min", ["merge", *map(str, runs), str(folder / "floor"), "--force"]
    )
    rows.append({**merged, **sizes(None, folder / "floor")})
    rows += [located(folder, mode) for mode in (Mode.ONE_SHOT, Mode.TRACK)]
    print_rows(rows, title="What things cost", as_json=False)


def simulated(walk: Path, told: tuple[str, int, int]) -> float:
    """How long a walk takes (s); it is simulated where it is missing."""
    world, rounds, seed = told
    if not walk.is_dir():
        write_recording(simulate(load_world(world), seed, rounds=rounds)[0], walk)
    imu = read_recording(walk).imu
    assert imu is not None, "a simulated walk has motion"
    return float(imu.t_s[-1])


def work(name: str, words: list[str]) -> Row:
    """Seconds of processor and memory of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*COMMAND, *words], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"work": name, "processor (s)": round(spent_s, 1)}


def sizes(walk: Path | None, made: Path | None) -> Row:
    """Bytes of a recording, of what was made of it, of its report, and of the map alone."""

    def kilobytes(place: Path | None, pattern: str) -> float | None:
        files = [] if place is None else [each for each in place.rglob(pattern) if each.is_file()]
        return round(sum(file.stat().st_size for file in files) / 1e3, 1) if files else None

    return {
        "recording (kB)": kilobytes(walk, "*"),
        "run (kB)": kilobytes(made, "*"),
        "report (kB)": kilobytes(made, "report.html"),
        "encoder (kB)": kilobytes(made, "encoder.onnx"),
        "map (kB)": kilobytes(made, "map.npz"),
    }


def located(folder: Path, mode: Mode) -> Row:
    """A walk located in the map of another, per fix."""
    known, place, heard = (
        Settings(),
        read_map(folder / "5-min-run"),
        read_recording(folder / "again"),
    )
    encoder = load_encoder("compact")
    start_s = time.process_time()
    fixes = slam.locate(heard, place, encoder, known, mode=mode)
    each_s = (time.process_time() - start_s) / max(len(fixes.t_s), 1)
    file = folder / "fixes.csv"
    write_fixes(fixes, file)
    each_kb = file.stat().st_size / max(len(fixes.t_s), 1) / 1e3
    row: Row = {"work": f"a fix, {mode}", "processor (s)": round(each_s, 4)}
    return {**row, **sizes(None, None), "run (kB)": round(each_kb, 3)}


if __name__ == "__main__":
    main()
