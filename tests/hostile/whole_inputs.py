"""Small whole files of every kind that a command reads, to be damaged: made once, in seconds."""

import json
import shutil
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import scipy.io
from foreign_encoders import GOOD, foreign_encoder
from forked_commands import Commands
from PIL import Image, ImageDraw
from planted_logs import LOGS, T_S
from planted_plans import SVG, pdf

from elfslam.base.values import Audio
from elfslam.data.audio_files import WAV
from elfslam.data.baseband import frame_starts_s, to_baseband
from elfslam.data.importing import LogFormat
from elfslam.data.recordings import write_recording
from elfslam.stages.chirp import ChirpParameters, describe_chirp, make_chirp
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world, simulate

RESULTS = """study,world,method,condition,metric,value
elf,hall,compact,1 footstep,AUC,0.9
"""
"""What was measured of an encoder."""
WORLD = """
name = "closet"
size_m = [4.0, 3.0, 2.5]
seed = 3
route_m = [[0.8, 0.8], [3.2, 0.8], [3.2, 2.2], [0.8, 2.2]]
spots = {from_m = [0.8, 0.8], to_m = [1.2, 0.8], spacing_m = 0.2}

[surfaces]
walls = ["gypsum board", "gypsum board", {name = "mine", absorption = 0.2}, "gypsum board"]
floor = "wood panel"
ceiling = {absorption = 0.3, scattering = 0.1}

[[furniture]]
name = "stool"
corner_m = [1.8, 1.3, 0.0]
size_m = [0.4, 0.4, 0.5]
turn_deg = 10.0
repeat = [1, 1]
spacing_m = [0.5, 0.5]

[[partition]]
name = "screen"
from_m = [0.0, 1.5]
to_m = [0.3, 1.5]
height_m = 1.5

[[state]]
name = "moved"
moved = [{name = "stool 1", by_m = [0.0, 0.1], turn_deg = 5.0}]

[people]
routes_m = [[[0.8, 0.8], [3.2, 0.8]]]
speed_mps = 1.0

[climate]
temperature_c = 20.0
humidity_percent = 50.0

[[access_point]]
bssid = "aa:bb"
position_m = [1.0, 1.0, 2.0]
channel = 6

[magnetic]
strength_ut = 49.0

[[power_line]]
name = "sockets"
from_m = [0.0, 0.0, 0.3]
to_m = [4.0, 0.0, 0.3]
current_a = [1.0, 0.1]
"""
PLACE = """
name = "House"
category = "university"
address = "Street 1"
locality = "Zurich"
country = "CH"
level = "Ground"
ordinal = 0
"""
PARAMETERS = """
[closure]
threshold = 0.5
[motion]
least_rate_hz = 20.0
[graph]
robust = true
[chirp]
kind = "chirp"
"""
MALL_START_MS = 1574559495255


def make_inputs(folder: Path, commands: Commands) -> None:
    """All of them, by name, in a folder."""
    scratch = folder / "scratch"
    scratch.mkdir()
    _recordings(folder)
    _runs(folder, commands, scratch)
    _logs(folder)
    (folder / "world.toml").write_text(WORLD)
    (folder / "place.toml").write_text(PLACE)
    (folder / "parameters.toml").write_text(PARAMETERS)
    (folder / "encoder.onnx").write_bytes(foreign_encoder(*GOOD))
    _plans(folder)
    (folder / "elf.csv").write_text(RESULTS)
    (folder / "marks.csv").write_text("name,x_m,y_m\na,0,0\nb,1,0\n")
    shutil.copy(folder / "walk" / "truth.tum", folder / "truth.tum")
    (folder / "waypoints.csv").write_text("t_s,x_m,y_m\n1,0,0\n9,1,1\n")
    scratch.rmdir()


def _recordings(folder: Path) -> None:
    told = describe_chirp()
    sensors = tuple(Sensor)
    walk, truth = simulate(load_world("studio"), 3, rounds=2, sensors=sensors)
    write_recording(walk, folder / "walk", chirp_description=told, truth=truth)
    shutil.make_archive(str(folder / "walk"), "zip", folder / "walk")
    again, truth = simulate(load_world("studio"), 4, rounds=2)
    write_recording(again, folder / "walk again", chirp_description=told, truth=truth)
    quiet, truth = simulate(load_world("studio"), 1, rounds=1, sound=False, sensors=sensors)
    write_recording(quiet, folder / "quiet", truth=truth)
    assert walk.audio is not None
    short = Audio(walk.audio.samples[:, : 6 * walk.audio.rate_hz], walk.audio.rate_hz)
    chirp = make_chirp(ChirpParameters(), short.rate_hz)
    kept = to_baseband(short, frame_starts_s(short, chirp))
    still = type(walk)("band", "phone", audio=short)
    write_recording(still, folder / "band", chirp_description=told, baseband=kept)
    _write_frames(folder / "frames", short)


def _write_frames(folder: Path, sound: Audio) -> None:
    """Ten frames of 80 ms, as a page keeps them."""
    import soundfile

    folder.mkdir()
    (folder / "recording.json").write_text('{"format_version": 1}')
    starts = np.arange(10) * sound.rate_hz // 10
    frames = [sound.samples[0, k : k + round(0.08 * sound.rate_hz)] for k in starts]
    soundfile.write(folder / "frames.wav", np.concatenate(frames), sound.rate_hz)
    rows = "".join(f"{k / sound.rate_hz:.9f}\n" for k in starts)
    (folder / "frames.csv").write_text(f"t_s\n{rows}")
    assert WAV not in folder.iterdir()


def _runs(folder: Path, commands: Commands, scratch: Path) -> None:
    orders = [
        ("map", "walk", "run"),
        ("map", "walk again", "other"),
        ("merge", "run", "other", "merged"),
        ("locate", "walk", "run", "fixes.csv"),
    ]
    for order in orders:
        ended = commands.run(order, folder, scratch)
        assert ended.code in (0, 1), ended.errors
    shutil.make_archive(str(folder / "quiet"), "zip", folder / "quiet")


def _logs(folder: Path) -> None:
    for log_format, made in LOGS.items():
        files = made()
        if log_format is LogFormat.GETSENSORDATA:
            (folder / "getsensordata.txt").write_text(files["walk.txt"])
            continue
        with zipfile.ZipFile(folder / f"{log_format}.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            for name, text in files.items():
                archive.writestr(name, text)
    (folder / "mall").mkdir()
    (folder / "mall" / "walk.txt").write_text(_mall())
    with tarfile.open(folder / "mall.tar.xz", "w:xz") as packed:
        packed.add(folder / "mall", "site")
    rows = len(T_S)
    made_mat = {
        "t": T_S[:, None],
        "tm": T_S[:, None],
        "quat": np.tile([0.5**0.5, 0.5**0.5, 0, 0], (rows, 1)),
        "m": np.tile([-40.0, 0.0, -20.0], (rows, 1)),
        "dPos": np.tile([0.0, 0.1, 0.0], (rows - 1, 1)),
    }
    scipy.io.savemat(folder / "magnetic.mat", made_mat, do_compression=True)


def _mall() -> str:
    kinds = {
        "ACCELEROMETER": "0.1\t0.2\t9.8\t3",
        "GYROSCOPE": "0.1\t0.2\t0.3\t3",
        "MAGNETIC_FIELD": "10\t20\t-30\t3",
        "ROTATION_VECTOR": "0\t0\t0.6\t3",
    }
    lines = [f"#\tstartTime:{MALL_START_MS}", "#\tBrand:OPPO\tModel:PBCM10"]
    for t_s in T_S:
        now_ms = MALL_START_MS + round(t_s * 1000)
        lines += [f"{now_ms}\tTYPE_{kind}\t{cells}" for kind, cells in kinds.items()]
    seen = f"shop\taa:bb\t-50\t2437\t{MALL_START_MS}"
    lines += [f"{MALL_START_MS + 9}\tTYPE_WIFI\t{seen}", f"{MALL_START_MS}\tTYPE_WAYPOINT\t1\t2"]
    return "\n".join(lines) + "\n"


def _plans(folder: Path) -> None:
    drawing = Image.new("L", (200, 160), 255)
    pen = ImageDraw.Draw(drawing)
    pen.rectangle((10, 10, 190, 150), outline=0, width=3)
    pen.rectangle((90, 60, 110, 90), fill=60)
    drawing.save(folder / "plan.png")
    corners = [[8.5, 47.3], [8.5001, 47.3], [8.5001, 47.3001], [8.5, 47.3001], [8.5, 47.3]]
    shape = {"type": "Polygon", "coordinates": [corners]}
    feature = {"type": "Feature", "geometry": shape, "properties": {"accessible": True}}
    plan = {"type": "FeatureCollection", "features": [feature]}
    (folder / "plan.geojson").write_text(json.dumps(plan))
    (folder / "plan.svg").write_text(SVG)
    (folder / "plan.pdf").write_bytes(pdf())
