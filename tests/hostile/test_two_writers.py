"""Two commands that write to one place, and one that is killed while it replaces an older run."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from killed import steps_of, survives

from elfslam.app.map import write_reported_run
from elfslam.base.values import Run
from elfslam.cli.app import run
from elfslam.data.map_files import read_facts
from elfslam.data.runs import read_run

pytestmark = pytest.mark.hostile

ELFSLAM = (sys.executable, "-c", "from elfslam.cli import main; main()")
KILLS = 12


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("walks") / "walk"
    assert run(["simulate", "studio", str(folder), "--rounds", "1"]) == 0
    return folder


@pytest.fixture(scope="module")
def small(walk: Path) -> Run:
    """A run that is quickly written."""
    assert run(["map", str(walk), f"{walk}-run", "--by", "motion"]) == 0
    return read_run(Path(f"{walk}-run"))


@pytest.mark.parametrize("force", [(), ("--force",)], ids=["first", "by force"])
def test_of_two_maps_at_once_the_one_that_is_seen_succeeded(
    walk: Path, tmp_path: Path, force: tuple[str, ...]
) -> None:
    """Without --force exactly one; the other says in one line what is in its way."""
    out = tmp_path / "out"
    command = [*ELFSLAM, "map", str(walk), str(out), "--by", "motion", *force]
    for _ in range(1 if force else 2):
        both = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
        ends = {process.communicate()[1].strip(): process.returncode for process in both}
        assert set(ends.values()) <= {0, 2}
        assert 0 in ends.values()
        refusals = [said for said, code in ends.items() if code == 2]
        assert force or len(refusals) == 1
        assert all("\n" not in said and str(out) in said for said in refusals)
        assert read_run(out).name == "studio"
        assert [item.name for item in tmp_path.iterdir()] == ["out"]
        if not force:
            for file in out.iterdir():
                file.unlink()


def test_a_folder_that_somebody_makes_meanwhile_is_kept(walk: Path, tmp_path: Path) -> None:
    """While the report is written, in a place that was free when the command began."""
    out = tmp_path / "out"
    plant = (
        "import elfslam.scoring.report as m, pathlib; write = m.write_report\n"
        f"def meanwhile(*given, **named):\n"
        f"    pathlib.Path({str(out)!r}).mkdir()\n"
        f"    pathlib.Path({str(out)!r}, 'thesis.txt').write_text('years of work')\n"
        "    write(*given, **named)\n"
        "m.write_report = meanwhile\n"
    )
    command = [sys.executable, "-c", plant + ELFSLAM[2], "map", str(walk), str(out)]
    ended = subprocess.run([*command, "--by", "motion"], capture_output=True, check=False)
    assert (ended.returncode, ended.stderr.count(b"\n")) == (2, 1)
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "thesis.txt"]


def test_a_killed_replacement_is_found_whole_and_finished(small: Run, tmp_path: Path) -> None:
    """Killed before every so-manieth step of the writing; `elfslam map --force` writes so."""

    def write(out: Path, what: str) -> None:
        write_reported_run(small, out, facts={"made": what}, encoder=b"x", replace=True)

    write(tmp_path / "whole", "old")
    steps, found = steps_of(lambda: write(tmp_path / "whole", "new")), []
    for k in range(KILLS):
        out = tmp_path / "kills" / str(k) / "out"
        write(out, "old")
        survives(k * steps // KILLS, lambda out=out: write(out, "new"))  # type: ignore[misc]
        assert run(["show", str(out), str(tmp_path / f"page-{k}.html")]) == 0
        read_run(out)
        found.append(read_facts(out)["made"])
        assert (out / "report.html").read_text().endswith("</html>\n")
        write(out, "newest")
        assert read_facts(out)["made"] == "newest"
        assert os.listdir(out.parent) == ["out"]
    assert found == sorted(found, reverse=True), "old until some step, new from then on"
    assert set(found) == {"old", "new"}
