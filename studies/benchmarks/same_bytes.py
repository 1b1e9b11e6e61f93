"""Are the files of two versions the same? Walks simulated and recorded, mapped, merged, located.

Usage, from the root of the project, with the recordings of other people beside it:

    python -m studies.benchmarks.same_bytes COMMIT [--only magnetic]

Runs the same commands and asks a server for the same exports in a checkout of COMMIT and in this
one, and prints a row a case with the names of the files that differ. Times and dates do not count.
"""

import argparse
import hashlib
import io
import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx

from elfslam.app.console import print_rows
from studies.benchmarks.served import PIECE, metadata

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("ELFSLAM_DATA", ROOT.parent / "shared" / "data"))
ELFSLAM = (sys.executable, "-c", "from elfslam.cli import main; main()")
TIMINGS = {"timings.json"}
TIMED = re.compile(
    rb'"(?:elfslam|version|made_at|date|commit|software)": "[^"]*"|\d{4}-\d\d-\d\d[T ][\d:.Z+]*'
)
MALL_WALKS = 4
PLACE = {"origin": "47.3769,8.5417,90", "name": "Studio", "category": "hotel", "address": "1 Way",
         "locality": "Zurich", "country": "CH", "level": "0", "ordinal": "0"}  # fmt: skip
Do = Callable[..., None]


def echoes(do: Do) -> None:
    """Two simulated walks in a room: mapped with fine-tuning and without, merged, located."""
    for seed in ("3", "4"):
        do("simulate", "studio", f"walk{seed}", "--seed", seed, "--sensors", "wifi,magnetic")
        do("map", f"walk{seed}", f"run{seed}", "--no-finetune")
    do("map", "walk3", "tuned")
    do("merge", "run3", "run4", "floor")
    for mode in ("one-shot", "trajectory", "track"):
        do("locate", "walk4", "run3", f"{mode}.csv", "--mode", mode)
    do("locate", "walk4", "floor", "floor.csv", "--mode", "track")
    for form in ("tum", "g2o", "parquet", "onnx"):
        do("export", "run3", f"run.{form}", "--to", form)


def cropped(do: Do) -> None:
    """A stretch of a walk of a pedestrian, cropped."""
    do("simulate", "living_room", "walk", "--seed", "5", "--kind", "people", "--rounds", "2")
    do("map", "walk", "run", "--from", "8", "--until", "60", "--no-finetune")
    do("map", "walk", "motion", "--from", "8", "--until", "60", "--by", "motion")


def magnetic(do: Do) -> None:
    """Two recorded walks by their magnetic field."""
    for name in ("square", "eight"):
        do("import", "magnetic", str(SHARED / "magnetic" / f"{name}.mat"), name)
        do("map", name, f"{name}-run", "--by", "magnetic")


def mall(do: Do) -> None:
    """Recorded walks of surveyors on one floor of a mall, by Wi-Fi and field."""
    do("import", "mall", "logs", "walks", "--declare-start")
    do("merge", "walks", "floor", "--by", "wifi,magnetic")
    first = sorted(path.name for path in _folder_of(do, "walks").iterdir())[0]
    do("map", f"walks/{first}", "run", "--by", "wifi,magnetic")
    do("locate", f"walks/{first}", "floor", "fixes.csv", "--by", "wifi,magnetic")


def server(do: Do) -> None:
    """A walk that is sent to a server, mapped there, and its exports."""
    do("simulate", "studio", "walk", "--seed", "6")
    with _serving(do) as client:
        for name, content in _exports(client, _folder_of(do, "walk")).items():
            (_folder_of(do, "exports") / name).write_bytes(content)


CASES = {case.__name__: case for case in (echoes, cropped, magnetic, mall, server)}


def made_by(checkout: Path, case: str, out: Path) -> dict[str, str]:
    """The digest of each file that a case makes with the code of a checkout."""
    environment = {**os.environ, "PYTHONPATH": str(checkout / "src")}

    def do(*arguments: str) -> None:
        ended = subprocess.run(
            [*ELFSLAM, *arguments],
            cwd=out, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if ended.returncode not in (0, 1):
            raise SystemExit(f"elfslam {' '.join(arguments)}: {ended.stderr.strip()[-300:]}")

    do.folder, do.environment = out, environment  # type: ignore[attr-defined]
    if case == "mall":
        _unpack_mall(out / "logs")
    CASES[case](do)
    return {
        path.relative_to(out).as_posix(): _digest(path)
        for path in sorted(out.rglob("*"))
        if path.is_file() and path.name not in TIMINGS and "data" not in path.relative_to(out).parts
    }


def _digest(path: Path) -> str:
    content = path.read_bytes()
    if path.suffix in (".json", ".html"):
        content = TIMED.sub(b"", content)
    return hashlib.sha256(content).hexdigest()


def _folder_of(do: Do, name: str) -> Path:
    folder: Path = do.folder / name  # type: ignore[attr-defined]
    folder.mkdir(exist_ok=True)
    return folder


def _unpack_mall(logs: Path) -> None:
    logs.mkdir()
    with tarfile.open(SHARED / "mall_walks" / "site1-F1.tar.xz") as archive:
        walks = sorted(name for name in archive.getnames() if name.endswith(".txt"))[:MALL_WALKS]
        for name in walks:
            found = archive.extractfile(name)
            assert found is not None
            (logs / Path(name).name).write_bytes(found.read())


@contextmanager
def _serving(do: Do) -> Iterator[httpx.Client]:
    environment = do.environment  # type: ignore[attr-defined]
    arguments = [*ELFSLAM, "serve", "--http", "--port", "0", "--data", str(_folder_of(do, "data"))]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        url, token = process.stdout.readline().strip().partition("&")[0].split("/#token=")
        bearer = {"Authorization": f"Bearer {token}"}
        try:
            with httpx.Client(base_url=url, headers=bearer, timeout=180) as client:
                yield client
        finally:
            process.terminate()


def _exports(client: httpx.Client, walk: Path) -> dict[str, bytes]:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for file in sorted(walk.iterdir()):
            archive.write(file, file.name)
    told = {"Upload-Metadata": metadata(filename="walk.zip"), "Upload-Length": str(packed.tell())}
    sent = client.post("/api/uploads", headers={**PIECE, **told}, content=packed.getvalue())
    place = sent.raise_for_status().headers["location"]
    recording = client.head(place, headers=PIECE).headers["elfslam-recording"]
    asked = client.post("/api/jobs", json={"kind": "map", "recording": recording})
    asked.raise_for_status()
    while not (maps := client.get("/api/maps").json()):
        time.sleep(1)
    base = f"/api/maps/{maps[0]['id']}"
    found = {"view.json": json.dumps(client.get(f"{base}/view").json(), sort_keys=True).encode()}
    for form in client.get(f"{base}/exports").json():
        asked_for = PLACE if form in ("geojson", "imdf") else {}
        answer = client.get(f"{base}/exports/{form}", params=asked_for).raise_for_status()
        found.update(_unpacked(form, answer.content))
    return found


def _unpacked(form: str, content: bytes) -> dict[str, bytes]:
    """An archive's files; its own bytes carry the time of packing."""
    if not zipfile.is_zipfile(io.BytesIO(content)):
        return {form: content}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {f"{form}-{name}": archive.read(name) for name in archive.namelist()}


def main() -> None:
    """Run every case with both versions and print what differs."""
    parser = argparse.ArgumentParser(prog="python -m studies.benchmarks.same_bytes")
    parser.add_argument("commit")
    parser.add_argument("--only", default="", help=f"cases, comma-separated: {', '.join(CASES)}")
    asked = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        before = Path(name) / "before"
        enter = ["git", "worktree", "add", "-q", "--detach", str(before), asked.commit]
        subprocess.run(enter, cwd=ROOT, check=True)
        try:
            for case in asked.only.split(",") if asked.only else CASES:
                digests = []
                for checkout in (before, ROOT):
                    with tempfile.TemporaryDirectory() as out:
                        digests.append(made_by(checkout, case, Path(out)))
                old, new = digests
                differ = sorted(k for k in old.keys() | new.keys() if old.get(k) != new.get(k))
                rows.append({"case": case, "files": len(old), "same": len(old) - len(differ),
                             "differ": ", ".join(differ) or "none"})  # fmt: skip
                print_rows(rows[-1:], title=case, as_json=False)
        finally:
            leave = ["git", "worktree", "remove", "--force", str(before)]
            subprocess.run(leave, cwd=ROOT, check=False)
    print_rows(rows, title=f"The same bytes as {asked.commit}?", as_json=False)


if __name__ == "__main__":
    main()
