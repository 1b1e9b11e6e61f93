"""A walk over two floors becomes a building on disk, in which each floor is a run folder."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from shapely.geometry import shape

import elfslam
from elfslam.app.export import ExportContext, export
from elfslam.app.locate import locate_from
from elfslam.app.map import MapJob, map_into, map_many
from elfslam.app.settings import Settings
from elfslam.base.enums import Format, Modality, Mode
from elfslam.base.errors import InputError, StoreError
from elfslam.base.values import FixStatus, LevelPassage, Levels, silent
from elfslam.cli.app import run
from elfslam.data.building_files import floor_folder, read_building
from elfslam.data.geographic import Origin
from elfslam.data.imdf import Venue
from elfslam.data.map_files import read_facts, read_map
from elfslam.data.named_places import read_points
from elfslam.data.plan_geojson import read_plan_shapes
from elfslam.data.recordings import write_recording
from elfslam.data.runs import read_run
from elfslam.world.simulate import load_world, simulate
from tests.data.imdf_rules import faults_of, read_imdf
from tests.stages.pressure import with_stairs

JOB = MapJob((), None, "compact", Settings(), overwrite=False)


def climbed(folder: Path, seed: int) -> Path:
    """Two rounds of the studio on one floor, two on the next."""
    recording, truth = simulate(load_world("studio"), seed=seed, rounds=4)
    middle_s = float(recording.imu.t_s[-1] / 2)
    by = (None, LevelPassage.STAIRS, None)
    levels = Levels(np.array([0.0, middle_s, middle_s + 10]), np.array([0, np.nan, 1]), by)
    up = with_stairs(recording, middle_s, 10.0)
    write_recording(up, folder, truth=replace(truth, levels=levels))
    return folder


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return climbed(tmp_path_factory.mktemp("recordings") / "walk", 107)


@pytest.fixture(scope="module")
def building(walk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("maps") / "building"
    map_into(folder, walk, JOB, silent)
    return folder


def test_the_whole_run_lies_at_the_top_and_each_floor_beneath(building: Path) -> None:
    whole, told = read_run(building), read_building(building)
    assert told.levels == (0, 1)
    assert whole.visited.floors == told.floors
    assert whole.floor_map is None
    assert "level 1" in (building / "report.html").read_text()
    for level in told.levels:
        folder = floor_folder(building, level)
        part = read_run(folder)
        assert read_facts(folder)["level"] == level
        assert (folder / "encoder.onnx").is_file()
        rows = np.isin(whole.trajectory.t_s, part.trajectory.t_s)
        poses = whole.trajectory.world_from_body[rows]
        npt.assert_allclose(part.trajectory.world_from_body, poses, atol=1e-6)
        npt.assert_array_equal(read_map(folder).xy_m, part.floor_map.xy_m)


def test_an_older_building_gives_way_only_where_that_is_said(building: Path, walk: Path) -> None:
    with pytest.raises(StoreError, match="already exists"):
        map_into(building, walk, JOB, silent)


def test_one_of_many_recordings_may_be_a_building(walk: Path, tmp_path: Path) -> None:
    job = MapJob((), None, "spectral", Settings(), overwrite=False)
    assert map_many(tmp_path, [walk], job, silent) == {}
    assert read_building(tmp_path / walk.name).levels == (0, 1)


@pytest.mark.parametrize("mode", list(Mode))
def test_a_query_is_located_on_its_own_floor(building: Path, walk: Path, mode: Mode) -> None:
    """Both floors are one room here: echo by echo they can hardly be told apart."""
    fixes = locate_from(walk, building, Settings(), mode=mode)
    visited = read_run(building).visited
    levels = visited.levels.at(fixes.t_s)
    assert len(fixes.t_s) > 30
    known = np.isfinite(fixes.level)
    npt.assert_array_equal(fixes.level[known], levels[known])
    on_stairs = np.isnan(levels)
    assert on_stairs.any()
    assert np.isnan(fixes.xy_m[on_stairs]).all()
    assert not np.isin(fixes.status[~known], [FixStatus.OK]).any()


def test_other_senses_than_echoes_are_refused(building: Path, walk: Path) -> None:
    with pytest.raises(InputError, match="in which echoes alone locate"):
        locate_from(walk, building, Settings(), by=[Modality.WIFI])


VENUE = Venue("Tower", "hotel", "Hauptstrasse 1", "Bern", "CH", "Ground floor", 0)
TOLD = ExportContext(Origin(47.0, 8.0), VENUE)


def test_its_levels_are_one_archive_of_imdf(building: Path, tmp_path: Path) -> None:
    export(building, tmp_path / "imdf.zip", Format.IMDF, TOLD)
    archive = read_imdf(tmp_path / "imdf.zip")
    assert faults_of(archive) == []
    told = [each["properties"] for each in archive["level"]["features"]]
    names = [(each["ordinal"], each["name"]["en"]) for each in told]
    assert names == [(0, "Ground floor"), (1, "Level 1")]
    amenities = archive["amenity"]["features"]
    assert [each["properties"]["category"] for each in amenities] == ["stairs", "stairs"]


def test_geojson_states_levels_that_are_read_again(building: Path, tmp_path: Path) -> None:
    file = tmp_path / "tower.geojson"
    export(building, file, Format.GEOJSON, TOLD)
    features = json.loads(file.read_text())["features"]
    assert {each["properties"]["level"] for each in features} == {"0", "1", "0;1"}
    for level in read_building(building).levels:
        drawn = read_plan_shapes(file, TOLD.origin, str(level))
        spots = [
            shape(each["geometry"])
            for each in features
            if each["properties"]["level"] == str(level) and each["properties"]["kind"] == "spot"
        ]
        assert len(spots) == len(read_map(floor_folder(building, level)).xy_m)
        assert len(drawn.lines) == 2  # the walk on that floor, and the stairs
    (stairs,) = [each for each in features if each["properties"]["level"] == "0;1"]
    assert shape(stairs["geometry"]).is_valid


def test_ros_gets_a_map_a_floor_and_others_ask_for_one(building: Path, tmp_path: Path) -> None:
    export(building, tmp_path / "map.yaml", Format.ROS, TOLD)
    for level in (0, 1):
        assert f"map_{level}.pgm" in (tmp_path / f"map_{level}.yaml").read_text()
        assert (tmp_path / f"map_{level}.pgm").is_file()
    export(building, tmp_path / "walk.tum", Format.TUM)
    export(building, tmp_path / "walk.onnx", Format.ONNX)
    with pytest.raises(StoreError, match="is a building, wanted one floor"):
        export(building, tmp_path / "walk.parquet", Format.PARQUET)


def test_scores_say_whether_floors_are_right(
    building: Path, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fixes = str(tmp_path / "fixes.csv")
    assert run(["locate", str(walk), str(building), fixes]) == 0
    capsys.readouterr()
    for what in (str(building), fixes):
        assert run(["score", what, str(walk), "--json"]) == 0
        row = json.loads(capsys.readouterr().out)[-1]
        assert row["floor_right"] > 0.95
    assert run(["score", str(building), str(walk)]) == 0
    said = capsys.readouterr().out
    assert "Errors by floor" in said
    assert "kind_right" in said


def test_buildings_of_walks_become_one(building: Path, walk: Path, tmp_path: Path) -> None:
    map_into(tmp_path / "second", climbed(tmp_path / "walk2", 108), JOB, silent)
    both = [str(building), str(tmp_path / "second")]
    out = tmp_path / "both"
    assert run(["merge", *both, str(out), "--known-starts"]) == 0
    told = read_building(out)
    assert told.levels == (0, 1)
    assert told.floors[0].height_m == 0
    for level in told.levels:
        made = read_map(floor_folder(out, level))
        assert made.sources == ("building", "second")
        assert (floor_folder(out, level) / "report.html").is_file()
    fixes = locate_from(walk, out, Settings())
    assert set(fixes.level[np.isfinite(fixes.level)]) == {0, 1}
    assert run(["merge", str(out), both[1], str(tmp_path / "again")]) == 2
    assert run(["merge", str(out), str(out), str(tmp_path / "again")]) == 2
    assert run(["merge", str(floor_folder(building, 0)), both[1], str(tmp_path / "mixed")]) == 2
    for name, folder in (("third", tmp_path / "second"), ("alone", floor_folder(building, 1))):
        shutil.copytree(folder, tmp_path / name)
    (tmp_path / "third" / "floors" / "0" / "points_of_interest.csv").write_text(
        "name,kind,x_m,y_m\nDesk,other,0.5,0.5\n"
    )
    more = [str(tmp_path / "third"), str(tmp_path / "alone")]
    assert run(["merge", str(out), str(tmp_path / "none")]) == 2
    assert run(["merge", more[1], str(out), more[0], str(tmp_path / "more")]) == 0
    assert read_building(tmp_path / "more").floors == told.floors
    grown = [floor_folder(tmp_path / "more", level) for level in told.levels]
    sources = [set(read_map(each).sources) for each in grown]
    assert sources[0] & sources[1] >= {"building", "second", "third"}
    assert "alone" in sources[0] ^ sources[1]
    assert [each.name for each in read_points(grown[0])] == ["Desk"]
    assert (grown[0] / "encoder.onnx").is_file()


def test_python_locates_in_a_run_over_several_floors(walk: Path) -> None:
    recording = elfslam.read_recording(walk)
    mapped = elfslam.map(recording, encoder="spectral")
    fixes = elfslam.locate(recording, mapped)
    assert set(fixes.level[np.isfinite(fixes.level)]) == {0, 1}
    with pytest.raises(InputError, match="over several floors"):
        elfslam.merge([mapped, mapped])
    with pytest.raises(InputError, match="no phone is learned"):
        elfslam.locate(recording, mapped, phone_walk=recording)
