"""What pip installs: the wheel holds the package alone, and its command maps and locates."""

import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from elfslam.data.recordings import write_recording
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world

pytestmark = pytest.mark.real
ROOT = Path(__file__).resolve().parents[1]
LARGEST_MB = 12.5


def run(*command: object, cwd: Path | None = None) -> str:
    """What a program says; where it fails, so does the test."""
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, as a build leaves its traces beside what it builds."""
    pytest.importorskip("setuptools")
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    shutil.copytree(ROOT / "src", source / "src", ignore=shutil.ignore_patterns("*.egg-info"))
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--quiet")
    run(sys.executable, "-m", "pip", "wheel", *options, "--wheel-dir", out, source)
    (made,) = out.iterdir()
    return made


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment that holds the wheel; others' packages come from here."""
    folder = tmp_path_factory.mktemp("installed") / "venv"
    run(sys.executable, "-m", "venv", "--without-pip", folder)
    python = folder / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python)
    run(*pip, "install", "--no-deps", "--no-index", "--quiet", wheel)
    told = "import sysconfig; print(sysconfig.get_path('purelib'))"
    place = Path(run(python, "-c", told).strip())
    (place / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "bin"


def test_it_holds_the_package_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    tops = {name.split("/")[0] for name in names}
    assert {top.partition("-")[0] for top in tops} == {"elfslam"}
    assert {"elfslam/weights/compact.onnx", "elfslam/world/worlds/studio.toml"} <= names
    assert {"elfslam/serve/pages/phone.html", "elfslam/py.typed"} <= names
    assert not [name for name in names if "/test" in name or name.endswith((".nbi", ".nbc"))]
    assert wheel.stat().st_size < LARGEST_MB * 1e6


def test_its_command_maps_and_locates(installed: Path, tmp_path: Path) -> None:
    """A walk simulated from here, whose kernels are compiled."""
    where = run(installed / "python", "-c", "import elfslam; print(elfslam.__file__)", cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(installed.parent)
    elfslam = installed / "elfslam"
    recording, _ = simulate(load_world("studio"), 107, rounds=3)
    write_recording(recording, tmp_path / "walk")
    run(elfslam, "map", "walk", "run", cwd=tmp_path)
    run(elfslam, "locate", "walk", "run", "fixes.csv", cwd=tmp_path)
    statuses = [line.split(",")[-1] for line in (tmp_path / "fixes.csv").read_text().split()[1:]]
    assert len(statuses) > 50
    assert statuses.count("OK") > 0.9 * len(statuses)
