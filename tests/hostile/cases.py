"""Which command is given which damaged file, and what has to hold however it ends."""

import os
import random
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from damaged_formats import damages_of
from forked_commands import Commands, Ended

MOST_BYTES = 2**30
OUT = "out"
EXPORTS = {"geojson": "geojson", "g2o": "g2o", "parquet": "parquet", "ros": "yaml", "imdf": "zip"}


@dataclass(frozen=True)
class Target:
    """A command, and the file or folder that is damaged before it comes.

    In the arguments {given} is what was damaged, {base} where the whole inputs are, and {out}
    where the result goes; `result` is what that is called, None where there is none.
    """

    family: str
    given: str
    arguments: str
    result: str | None = OUT

    def __str__(self) -> str:
        return f"{self.arguments} of {self.given}"


def _targets() -> Iterator[Target]:
    for walk in ("walk", "quiet", "band", "frames", "walk.zip", "quiet.zip"):
        yield Target("recordings", walk, "map {given} {out}")
        yield Target("recordings", walk, "locate {given} {base}/run {out}", "out.csv")
    for by in ("motion", "wifi", "magnetic", "emr", "elf,wifi"):
        yield Target("recordings", "walk", f"map {{given}} {{out}} --by {by}")
    yield Target("recordings", "walk", "locate {given} {base}/run {out} --mode tracking", "out.csv")
    yield Target(
        "recordings", "walk", "locate {base}/walk {base}/run {out} --phone-walk {given}", "out.csv"
    )
    yield from _of_maps()
    for world in (
        "simulate {given} {out} --rounds 1 --sensors wifi,magnetic,emr",
        "simulate {given} {out} --rounds 1 --state moved --people 2 --day 40",
    ):
        yield Target("worlds", "world.toml", world)
    yield Target("worlds", "world.toml", "show {given} {out}", "out.html")
    yield Target("worlds", "world.toml", "map {base}/quiet {out} --floor-plan {given}")
    for plan in ("plan.png", "plan.svg", "plan.pdf", "plan.geojson"):
        told = "{given}" + ("" if plan == "plan.geojson" else ":10")
        yield Target("plans", plan, f"anchor {{base}}/run {told} {{out}}")
        yield Target("plans", plan, f"anchor {{base}}/run {told} {{out}} --start 2,2,0 --follow")
        yield Target("plans", plan, f"map {{base}}/quiet {{out}} --floor-plan {told}")
    yield Target("parameters", "parameters.toml", "parameters --parameters {given}", None)
    yield Target("parameters", "parameters.toml", "map {base}/quiet {out} --parameters {given}")
    yield Target(
        "parameters",
        "place.toml",
        "export {base}/run {out} --to imdf --origin 47,8 --place {given}",
        "out.zip",
    )
    yield Target("encoders", "encoder.onnx", "map {base}/walk {out} --encoder {given}")
    yield Target(
        "encoders",
        "encoder.onnx",
        "locate {base}/walk {base}/run {out} --encoder {given}",
        "out.csv",
    )
    yield Target("encoders", "encoder.onnx", "card {given}", None)
    yield Target("encoders", "elf.csv", "card --measured {given} --out {out}", "out.onnx")
    for log in (
        "phyphox.zip",
        "sensorlogger.zip",
        "ronin.zip",
        "getsensordata.txt",
        "magnetic.mat",
    ):
        yield Target("logs", log, f"import {log.partition('.')[0]} {{given}} {{out}}")
        yield Target("logs", log, "import auto {given} {out}")
    for mall in ("mall", "mall.tar.xz"):
        yield Target("logs", mall, "import mall {given} {out}")
        yield Target("logs", mall, "import auto {given} {out}")
    yield Target("fixes and truths", "fixes.csv", "score {given} {base}/walk", None)
    for truth in ("truth.tum", "waypoints.csv"):
        yield Target("fixes and truths", truth, "score {base}/fixes.csv {given}", None)
    yield Target("fixes and truths", "marks.csv", "marks {base}/walk {given} a b", None)


def _of_maps() -> Iterator[Target]:
    for made in ("run", "merged"):
        for kind, ending in EXPORTS.items():
            where = "--origin 47,8 --place {base}/place.toml"
            yield Target(
                "maps", made, f"export {{given}} {{out}} --to {kind} {where}", f"out.{ending}"
            )
        yield Target("maps", made, "show {given} {out}", "out.html")
        yield Target("maps", made, "locate {base}/walk {given} {out}", "out.csv")
        yield Target("maps", made, "anchor {given} {base}/plan.png:10 {out}")
        yield Target("maps", made, "anchor {given} {base}/plan.png:10 {out} --start 2,2,0 --follow")
    yield Target("maps", "run", "score {given} {base}/walk", None)
    yield Target("maps", "run", "merge {given} {base}/other {out}")
    yield Target("maps", "run", "merge {base}/merged {given} {out}")
    yield Target("maps", "merged", "merge {given} {base}/other {out}")


TARGETS = tuple(_targets())
FAMILIES = tuple(dict.fromkeys(target.family for target in TARGETS))


def copied(base: Path, given: str, folder: Path) -> Path:
    """The input in a folder of its own; what is not damaged stays the same file on the disk."""
    source, target = base / given, folder / given
    if source.is_dir():
        shutil.copytree(source, target, copy_function=os.link)
    else:
        os.link(source, target)
    return target


def damaged(given: Path, chance: random.Random) -> str:
    """Damage an input, or a file of it; what was done, in words."""
    files = (
        [given] if given.is_file() else sorted(file for file in given.rglob("*") if file.is_file())
    )
    file = chance.choice(files)
    damage = chance.choice(damages_of(file))
    _apart(file)
    damage(file, chance)
    return f"{file.name} {damage.__name__}"


def _apart(file: Path) -> None:
    """Let no change reach the file that others share."""
    content = file.read_bytes()
    file.unlink()
    file.write_bytes(content)


def run(
    commands: Commands, target: Target, given: Path, base: Path, folder: Path
) -> tuple[Ended, list[str]]:
    """How the command ends that is given a damaged input, and what it did wrong."""
    scratch = folder / "scratch"
    scratch.mkdir()
    result = None if target.result is None else folder / target.result
    places: Mapping[str, object] = {"given": given, "base": base, "out": result}
    before = set(folder.iterdir())
    arguments = [word.format(**places) for word in target.arguments.split()]
    ended = commands.run(arguments, folder, scratch)
    left = [file.name for file in scratch.iterdir()]
    made = set(folder.iterdir()) - before
    left += [file.name for file in made if result is None or file.stem != result.stem]
    if given.is_dir():
        left += [file.name for file in given.iterdir() if file.name.startswith(".")]
    return ended, faults_of(ended, result, left)


def faults_of(ended: Ended, result: Path | None, left: list[str]) -> list[str]:
    """What a command did wrong; `left` are files that it should have taken away."""
    faults = []
    if "Traceback" in ended.errors:
        last = [line for line in ended.errors.splitlines() if line and not line.startswith(" ")][-1]
        faults.append(f"traceback ({last:.200})")
    elif ended.code not in (0, 1, 2):
        faults.append(f"exit code {ended.code}")
    elif ended.code == 2 and (len(ended.errors.splitlines()) != 1 or len(ended.errors) > 2000):
        faults.append(f"refusal of {len(ended.errors.splitlines())} lines ({ended.errors!r:.300})")
    if "Warning:" in ended.errors or "more memory than there is" in ended.errors:
        faults.append(f"warning ({ended.errors!r:.300})")
    if left:
        faults.append(f"partial output ({', '.join(left)})")
    if result is not None and ended.code == 2 and result.exists():
        faults.append("partial output (refused, and there it is)")
    if result is not None and ended.code == 0 and not result.exists():
        faults.append("exit code 0 (and there is nothing)")
    if ended.peak_bytes > MOST_BYTES:
        faults.append(f"memory ({ended.peak_bytes / 1e6:.0f} MB)")
    return faults
