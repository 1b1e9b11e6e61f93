"""What whoever has no phone at hand, and no building, can look at: simulated, and shipped as data.

    python -m studies.demonstration [walks|building]

The phone page plays two walks: one maps a lounge, the other, by somebody else another day, is
located there. Each is a FLAC file with the band of the chirps and a JSON file with what was played
and what moved. The desk loads the demonstration building: two floors of an office tower, mapped in
one walk, and a walk by somebody else on the upper floor, which is to be merged.
"""

import io
import json
import shutil
import sys
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
from PIL import Image, ImageDraw
from scipy import signal

from elfslam import serve
from elfslam.app.anchor import floor_plan
from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.base.arrays import F64
from elfslam.base.values import PointKind, PointOfInterest, Recording, silent
from elfslam.data.building_files import floor_folder
from elfslam.data.map_files import read_facts
from elfslam.data.named_places import write_points
from elfslam.data.recordings import write_recording
from elfslam.data.runs import read_run
from elfslam.scoring.report import write_report
from elfslam.serve.demonstration import FILE as BUILDING_FILE
from elfslam.serve.demonstration import MAPS
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.jobs.work import facts_of_floors, facts_of_run
from elfslam.stages.chirp import describe_chirp
from elfslam.world.building import MultiFloorWorld, load_place
from elfslam.world.circumstances import Circumstances
from elfslam.world.device import BROWSER
from elfslam.world.simulate import load_world, simulate
from elfslam.world.simulate_building import simulate_building
from elfslam.world.world_file import World

FOLDER = Path(serve.__path__[0]) / "pages" / "demonstration"
WORLD, ROUNDS = "lounge", 3
SEEDS = {"walk": 7, "other": 8}
AS_PLAYED = Circumstances(jitter_s=0.025, softer_db=4.0)
"""As the page plays them."""
BAND_HZ = (14_300.0, 20_700.0)
"""What lies outside is noise, and would be most of the file."""


def write_walk(recording: Recording, folder: Path, name: str) -> None:
    """A recording as the two files of a walk."""
    audio, imu = recording.audio, recording.imu
    assert audio is not None
    assert imu is not None
    assert recording.played_t_s is not None
    assert recording.gain_db is not None
    band = signal.butter(8, BAND_HZ, "bandpass", fs=audio.rate_hz, output="sos")
    sound = signal.sosfiltfilt(band, audio.samples[0])
    soundfile.write(
        folder / f"{name}.flac", sound, audio.rate_hz, subtype="PCM_16", compression_level=1.0
    )
    moved = np.column_stack([imu.t_s, imu.accel_mps2, imu.gyro_radps])
    played = np.column_stack([recording.played_t_s, recording.gain_db])
    told = {"played": played.round(6).tolist(), "motion": moved.round(4).tolist()}
    (folder / f"{name}.json").write_text(json.dumps(told, separators=(",", ":")) + "\n")


BUILDING, VENUE = "tower", "Demonstration building"
MAPPED, OTHER = (19, (0, 1)), (18, (1,))
"""Seeds and plans of the walk that maps both floors, and of that which is to be merged."""
LAPS = 2
LEFT_OUT = ("echoes.npz", "encoder.onnx")
"""What no page needs, and what is the package's own."""
PIXELS_PER_M, MARGIN_M = 30.0, 0.5
PLACES = {
    0: (("Reception", PointKind.ROOM, 6.5, 9.5), ("Post room", PointKind.ROOM, 31.5, 9.5)),
    1: (("Kitchen", PointKind.ROOM, 11.5, 9.5), ("Meeting room", PointKind.ROOM, 26.5, 9.5)),
}
COMMON = (("Stairs", PointKind.STAIRS, 1.2, 7.0), ("Lift", PointKind.LIFT, 38.8, 7.0))


def write_building(out: Path) -> None:
    """The demonstration building as a file that the server loads."""
    place = load_place(BUILDING)
    assert isinstance(place, MultiFloorWorld)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        mapped, other = (
            _mapped(folder / str(seed), place, seed, plan) for seed, plan in (MAPPED, OTHER)
        )
        told = []
        for facts in facts_of_floors(mapped):
            level = facts["level"]
            _write_plan(folder / "plan.png", place.storey(level).world)
            source = floor_folder(mapped, level)
            shutil.copyfile(folder / "plan.png", source / FLOOR_PLAN)
            write_points([PointOfInterest(*each) for each in (*PLACES[level], *COMMON)], source)
            its = {**facts, "frame": "floor 0"}
            told.append(_row(source, f"floor {level}", str(level), its, shared=level == 0))
        told.append(_row(other, "walk", "1", dict(facts_of_run(read_run(other))), shared=False))
        _pack(out, told)


def _mapped(folder: Path, place: MultiFloorWorld, seed: int, plan: tuple[int, ...]) -> Path:
    """The map of a simulated walk that states where it begins."""
    recording, truth = simulate_building(place, seed, plan=plan, rounds=LAPS)
    x_m, y_m, heading_rad = map(float, truth.world_from_body[0])
    known = replace(recording, name=VENUE, start_pose=(x_m, y_m, heading_rad))
    write_recording(known, folder / "recording", chirp_description=describe_chirp())
    job = MapJob((), None, "compact", Settings(), overwrite=False)
    map_into(folder / "map", folder / "recording", job, silent)
    return folder / "map"


def _row(
    source: Path, folder: str, floor: str, facts: dict[str, Any], *, shared: bool
) -> dict[str, Any]:
    """What the server is told of a map; `source` is where its files lie by now."""
    is_floor = (source / FLOOR_PLAN).is_file()
    return {
        "source": str(source), "folder": folder, "kind": "run", "venue": VENUE, "floor": floor,
        "name": f"Floor {floor}" if is_floor else f"Another walk on floor {floor}",
        "facts": facts, "floor_plan": _plan_facts(source) if is_floor else None, "shared": shared,
    }  # fmt: skip


def _plan_facts(source: Path) -> dict[str, Any]:
    with Image.open(source / FLOOR_PLAN) as picture:
        width_px, height_px = picture.size
    width_m = width_px / PIXELS_PER_M
    where = {"x_m": -MARGIN_M, "y_m": -MARGIN_M, "heading_rad": 0.0, "opacity": 0.5}
    placement = {"width_m": width_m, **where}
    facts = {"type": "image/png", "width_px": width_px, "height_px": height_px}
    return {**facts, "width_m": width_m, "placement": placement}


def _write_plan(file: Path, world: World) -> None:
    """The walls of a floor as a picture, north up."""
    size_m = world.room.size_m[:2] + 2 * MARGIN_M
    width_px, height_px = (int(each) for each in np.round(size_m * PIXELS_PER_M))
    picture = Image.new("L", (width_px, height_px), 255)
    pencil = ImageDraw.Draw(picture)

    def pixels(ring_m: F64) -> list[tuple[float, float]]:
        from_corner = (ring_m + MARGIN_M) * PIXELS_PER_M
        return [(float(x), float(height_px - y)) for x, y in from_corner]

    plan = floor_plan(world.room)
    pencil.line(pixels(np.vstack([plan.outline, plan.outline[:1]])), fill=0, width=5)
    for ring_m in plan.obstacles:
        pencil.polygon(pixels(ring_m), fill=150, outline=90)
    picture.quantize(16).save(file, "PNG", optimize=True)


def _pack(out: Path, told: list[dict[str, Any]]) -> None:
    """Everything in one file, its dates left out, so that the same maps give the same bytes."""
    with zipfile.ZipFile(out, "w") as archive:
        for each in told:
            source = Path(each.pop("source"))
            write_report(source / "report.html", read_run(source), facts=read_facts(source))
            for file in sorted(source.iterdir()):
                if file.is_file() and file.name not in LEFT_OUT and file.suffix != ".js":
                    _put(archive, f"{each['folder']}/{file.name}", _halved(file))
        _put(archive, MAPS, json.dumps(told).encode())


def _put(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED, compresslevel=9)


def _halved(file: Path) -> bytes:
    """A file, its features in half precision, which moves fixes by hundredths of millimetres."""
    if file.suffix != ".npz":
        return file.read_bytes()
    with np.load(file, allow_pickle=False) as arrays:
        kept = {
            name: array.astype(np.float16) if array.dtype == np.float32 else array
            for name, array in arrays.items()
        }
    content = io.BytesIO()
    np.savez_compressed(content, **kept)
    return content.getvalue()


def write_walks() -> None:
    """Both walks of the phone page."""
    FOLDER.mkdir(exist_ok=True)
    for name, seed in SEEDS.items():
        recording, _ = simulate(
            load_world(WORLD), seed, rounds=ROUNDS, grade=BROWSER, circumstances=AS_PLAYED
        )
        write_walk(recording, FOLDER, name)


def main() -> None:
    """Write the walks, the building, or both anew."""
    wanted = sys.argv[1:] or ["walks", "building"]
    if "walks" in wanted:
        write_walks()
    if "building" in wanted:
        write_building(BUILDING_FILE)


if __name__ == "__main__":
    main()
