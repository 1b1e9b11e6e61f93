"""The command as a user meets it: the whole line, and every bad input refused in one line."""

import json
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile
from PIL import Image
from planted_logs import LOGS

from elfslam.app.card import ON_THE_CARD
from elfslam.base.grid import resampled
from elfslam.base.values import FloorMap, Imu, Recording
from elfslam.cli.app import VERBS, command_of, run
from elfslam.data.importing import LogFormat
from elfslam.data.map_files import read_map, write_map
from elfslam.data.phyphox import phyphox_experiment
from elfslam.data.recordings import read_recording, write_recording
from elfslam.scoring.truth import read_truth
from elfslam.stages.chirp import ChirpParameters
from elfslam.stages.feature import load_encoder
from elfslam.world.kinds import ASKING_PHONE, MAPPING_PHONE
from tests.data.foreign_walk import packed, put_back

SENSORS = ("ACCELEROMETER", "GYROSCOPE")
Outcome = tuple[int, str, str]
Elfslam = Callable[..., Outcome]


def run_command(*arguments: object) -> int:
    """The exit code of `elfslam ARGUMENTS` in this process."""
    return run(list(map(str, arguments)))


@pytest.fixture
def elfslam(capsys: pytest.CaptureFixture[str]) -> Elfslam:
    def ended(*arguments: object) -> Outcome:
        capsys.readouterr()
        code = run_command(*arguments)
        seen = capsys.readouterr()
        return code, seen.out, seen.err

    return ended


WALK = ("--seed", 107, "--rounds", 3, "--as-drawn")


@pytest.fixture(scope="session")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated recording with its truth."""
    folder = tmp_path_factory.mktemp("simulated") / "walk"
    assert run_command("simulate", "studio", folder, *WALK) == 0
    return folder


@pytest.fixture(scope="session")
def mapped(walk: Path) -> Path:
    """The run made of it."""
    folder = walk.parent / "run"
    assert run_command("map", walk, folder) == 0
    return folder


@pytest.fixture
def copy(walk: Path, tmp_path: Path) -> Path:
    """A copy of the recording to damage."""
    return Path(shutil.copytree(walk, tmp_path / "copy"))


def test_a_kind_of_walk_is_asked_for_by_name(elfslam: Elfslam, tmp_path: Path) -> None:
    """Each option still changes what it says."""
    short = ("simulate", "studio", "--seed", 107, "--rounds", 1, "--engine", "images")
    phones = []
    for k, more in enumerate([("people",), ("people", "--asking"), ("people", "--device", "flat")]):
        out = tmp_path / f"{k}"
        assert elfslam(*short, out, "--kind", *more)[0] == 0
        phones.append(read_recording(out).device)
    assert [phone.split(",")[0] for phone in phones] == [MAPPING_PHONE, ASKING_PHONE, "flat"]


def test_circumstances_change_the_sound_and_are_not_told(tmp_path: Path, elfslam: Elfslam) -> None:
    """The manifest names the phone, as a real one would, and says no more of them."""
    plain, busy = tmp_path / "plain", tmp_path / "busy"
    walk = ("--rounds", 1, "--seed", 4321)
    asked = ("--state", "moved", "--day", 8765, "--people", 7, "--volume", 0.37)
    sounds = ("--sounds", "speech,clicks", "--other-phones", 1)
    assert elfslam("simulate", "studio", plain, *walk)[0] == 0
    assert elfslam("simulate", "studio", busy, *walk, *asked, *sounds)[0] == 0
    for file in ("recording.json", "truth.tum", "gyroscope.csv"):
        assert (busy / file).read_bytes() == (plain / file).read_bytes()
    assert (busy / "audio.flac").read_bytes() != (plain / "audio.flac").read_bytes()
    assert "4321" not in (plain / "recording.json").read_text()


def test_mapping_writes_a_run_that_never_saw_the_truth(
    walk: Path, mapped: Path, copy: Path, tmp_path: Path, elfslam: Elfslam
) -> None:
    (copy / "truth.tum").unlink()
    assert elfslam("map", copy, tmp_path / "blind")[0] == 0
    for file in ("trajectory.tum", "closures.csv"):
        assert (tmp_path / "blind" / file).read_bytes() == (mapped / file).read_bytes()
    files = {"encoder.onnx", "map.npz", "run.json", "timings.json", "report.html"}
    assert files <= {file.name for file in mapped.iterdir()}


def test_slam_beats_dead_reckoning(walk: Path, mapped: Path, elfslam: Elfslam) -> None:
    code, out, _ = elfslam("score", mapped, walk, "--json", "--floor-plan", "studio")
    medians = {(row["method"], row["alignment"]): row["median_m"] for row in json.loads(out)}
    assert code == 0
    assert medians["SLAM", "aligned"] < 0.8 * medians["dead reckoning", "aligned"]
    assert medians["SLAM", "aligned with scale"] < 0.25
    assert 1_000 < (mapped / "score.html").stat().st_size < 500_000


def test_another_walk_is_found(walk: Path, mapped: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    stranger, fixes = tmp_path / "stranger", tmp_path / "fixes.csv"
    elfslam("simulate", "studio", stranger, "--seed", 108, "--rounds", 1)
    assert elfslam("locate", stranger, mapped, fixes)[0] == 0
    code, out, _ = elfslam("score", fixes, stranger, "--map", mapped, "--map-truth", walk, "--json")
    ok = next(row for row in json.loads(out) if row["status"] == "OK")
    assert code == 0
    assert ok["coverage"] > 0.5
    assert ok["median_m"] < 0.6


@pytest.mark.parametrize("mode", ["trajectory", "track"])
def test_footsteps_help(
    walk: Path, mapped: Path, tmp_path: Path, elfslam: Elfslam, mode: str
) -> None:
    fixes = tmp_path / "fixes.csv"
    assert elfslam("locate", walk, mapped, fixes, "--mode", mode, "--seed", 3)[0] == 0
    rows = fixes.read_text().splitlines()
    assert rows[0] == "t_s,x_m,y_m,heading_rad,sigma_m,status"
    assert sum(row.endswith(",OK") for row in rows) > 0.9 * (len(rows) - 1)


def test_a_phone_is_learnt_from_a_walk_of_its_own(
    walk: Path, mapped: Path, tmp_path: Path, elfslam: Elfslam
) -> None:
    plain, told = tmp_path / "plain.csv", tmp_path / "told.csv"
    assert elfslam("locate", walk, mapped, plain)[0] == 0
    assert elfslam("locate", walk, mapped, told, "--phone-walk", walk)[0] == 0
    assert plain.read_text() != told.read_text()
    short = ("--set", "phone.fewest_windows=100000")
    code, _, err = elfslam("locate", walk, mapped, told, "--phone-walk", walk, *short, "--force")
    assert (code, "walk longer" in err) == (2, True)


def test_another_building_is_unknown(mapped: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    elfslam("simulate", "office", tmp_path / "office", "--seed", 109, "--rounds", 1, "--asking")
    fixes = tmp_path / "fixes.csv"
    code, out, err = elfslam("locate", tmp_path / "office", mapped, fixes, "--json")
    counts = json.loads(out)[0]
    assert code == (1 if counts["OK"] == 0 else 0)
    assert counts["UNKNOWN_PLACE"] >= 0.9 * counts["fixes"]
    assert code == 0 or "nowhere in" in err


def test_the_parameters_are_listed_and_can_be_set(elfslam: Elfslam) -> None:
    code, out, _ = elfslam("parameters", "--json", "--set", "closure.threshold=0.5")
    table = {row["name"]: row for row in json.loads(out)}
    assert code == 0
    assert table["closure.threshold"]["value"] == 0.5
    assert all(row["meaning"] for row in table.values())


def test_a_walk_without_a_second_round_says_so_and_still_writes_its_run(
    tmp_path: Path, elfslam: Elfslam
) -> None:
    elfslam("simulate", "studio", tmp_path / "walk", "--seed", 110, "--rounds", 1)
    code, _, err = elfslam("map", tmp_path / "walk", tmp_path / "run")
    assert code == 1
    assert "no loop closure" in err
    assert (tmp_path / "run" / "trajectory.tum").exists()


def test_a_loss_that_moves_the_beat_is_put_back_and_reported(
    copy: Path, mapped: Path, tmp_path: Path, elfslam: Elfslam
) -> None:
    samples, rate_hz = soundfile.read(copy / "audio.flac", dtype="float32")
    at = 20 * rate_hz + 3000
    kept = np.delete(samples, slice(at, at + 53 * rate_hz // 100))
    soundfile.write(copy / "audio.flac", kept, rate_hz, subtype="PCM_24")
    code, _, err = elfslam("map", copy, tmp_path / "run")
    assert code == 0
    assert "lacks 0.53 s and jumps at 20." in err
    before, after = (np.loadtxt(run / "trajectory.tum") for run in (mapped, tmp_path / "run"))
    assert np.median(np.linalg.norm(before[:, 1:3] - after[:, 1:3], axis=1)) < 0.3


def test_a_stretch_of_a_walk_is_mapped_and_what_it_lacks_is_said(
    copy: Path, tmp_path: Path, elfslam: Elfslam
) -> None:
    rows = (copy / "accelerometer.csv").read_text().splitlines(keepends=True)
    kept = [rows[0], *(row for row in rows[1:] if not 15 < float(row.split(",")[0]) < 18)]
    (copy / "accelerometer.csv").write_text("".join(kept))
    code, _, err = elfslam("map", copy, tmp_path / "run", "--from", 3.5)
    assert code == 0
    assert "motion is missing from 15.0 to 18.0 s" in err
    assert "motion is missing from 0" not in err
    assert np.loadtxt(tmp_path / "run" / "odometry.tum")[0, 0] > 3.5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["map", "{walk}", "{tmp}/out", "--set", "closure.treshold=0.5"], "closure.threshold"),
        (["map", "{walk}", "{tmp}/out", "--by", "magnetic"], "magnetometer"),
        (["map", "{walk}", "{tmp}/out", "--start", "here"], "X,Y,HEADING"),
        (["map", "{walk}", "{tmp}/out", "--start", "1,2"], "start has no heading"),
        (["map", "{walk}", "{tmp}/out", "--floor-plan", "atlantis"], "atlantis"),
        (["map", "{walk}", "{tmp}/out", "--from", "9", "--until", "8"], "the first before the"),
        (["map", "{walk}", "{walk}"], "is read from there"),
        (["locate", "{walk}", "{mapped}", "{tmp}/out", "--encoder", "spectral"], "encoder"),
        (["locate", "{walk}", "{walk}", "{tmp}/out"], "map"),
        (["score", "{tmp}/none.csv", "{walk}", "--map", "{mapped}"], "--map-truth"),
        (["simulate", "atlantis", "{tmp}/out"], "studio"),
        (["simulate", "studio", "{walk}"], "exists"),
        (["simulate", "studio", "{tmp}/out", "--kind", "lazy"], "wanted people, surveyor, quiet"),
        (["simulate", "studio", "{tmp}/out", "--device", "tablets"], "did you mean 'tablet'"),
        (["marks", "{walk}", "{tmp}/none.csv", "M1"], "truth.tum"),
        (["import", "ronin", "{walk}", "{tmp}/out"], "acce.txt"),
        (["import", "auto", "{walk}/truth.tum", "{tmp}/out"], "which no known log does"),
        (["import", "auto", "{walk}", "{tmp}/out"], "is a recording already"),
        (["import", "radar", "{walk}", "{tmp}/out"], "'radar': wanted auto, mall"),
        (["phyphox", "{tmp}/e.phyphox", "--set", "chirp.period_s=0.100001"], "chirp.period_s"),
        (["map", "--nonsense"], "elfslam --help"),
        (["map"], "elfslam --help"),
        (["sing"], "elfslam --help"),
        (["map", "a"], "elfslam --help"),
        (["map", "{walk}", "{tmp}/out", "--finetune", "--encoder", "spectral"], "that learns"),
        (["map", "{walk}", "{tmp}/out", "--finetune", "--by", "motion"], "motion (--finetune)"),
        (["map", "{walk}", "{tmp}/out", "--finetune"], "walk longer"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(
    arguments: list[str], words: str, walk: Path, mapped: Path, tmp_path: Path, elfslam: Elfslam
) -> None:
    filled = [text.format(tmp=tmp_path, walk=walk, mapped=mapped) for text in arguments]
    code, out, err = elfslam(*filled)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert words in err
    assert list(tmp_path.iterdir()) == []


def test_what_would_help_names_its_option(walk: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    """By that of the verb, else by that of another; an older result by --force where there is."""
    (tmp_path / "old").write_text("mine")
    for arguments, hint in (
        (("map", walk, tmp_path / "out", "--start", "here"), "(--start)"),
        (("export", walk, tmp_path / "out", "--to", "onnx"), "(elfslam map --by elf)"),
        (("phyphox", tmp_path / "old"), "or replace an older result with --force"),
    ):
        code, _, err = elfslam(*arguments)
        assert (code, err.endswith(f"{hint}\n")) == (2, True), err


def test_a_phyphox_experiment_is_written(tmp_path: Path, elfslam: Elfslam) -> None:
    code, out, err = elfslam("phyphox", tmp_path / "e.phyphox", "--minutes", "3")
    assert (code, out) == (0, "")
    assert "3 minutes takes about 346 MB" in err
    assert (tmp_path / "e.phyphox").read_bytes() == phyphox_experiment(ChirpParameters(), 3.0)


def test_marks_give_a_walk_its_truth(tmp_path: Path, elfslam: Elfslam) -> None:
    t_s = np.arange(3000) / 100
    moving = ((t_s > 4) & (t_s < 14)) | ((t_s > 17) & (t_s < 26))
    accel = np.column_stack([0 * t_s, 0 * t_s, 9.81 + 3 * moving * np.sin(12 * t_s)])
    recording = Recording("walk", "phone", imu=Imu(t_s, accel, 0 * accel))
    write_recording(recording, tmp_path / "walk")
    (tmp_path / "marks.csv").write_text("name,x_m,y_m\nM1,1,2\nM2,9.5,2\n")
    given = ("marks", tmp_path / "walk", tmp_path / "marks.csv", "M1", "M2", "M1")
    assert elfslam(*given)[0] == 0
    truth = read_truth(tmp_path / "walk")
    np.testing.assert_allclose(truth.t_s, [2, 15.5, 28], atol=0.6)
    np.testing.assert_array_equal(truth.world_from_body[:, :2], [[1, 2], [9.5, 2], [1, 2]])
    code, _, err = elfslam(*given)
    assert code == 2
    assert "is there already" in err


@pytest.mark.parametrize("verb", VERBS)
def test_every_help_is_sentences_that_end(verb: str) -> None:
    command = command_of(verb)
    told = [command.help, *(each.help for each in command.params if each.name != "help")]
    assert [text for text in told if not (text or "").endswith(".")] == []


def test_one_bad_log_among_many_costs_no_other(tmp_path: Path, elfslam: Elfslam) -> None:
    rows = [f"{k * 20}\tTYPE_{kind}\t0\t0\t9.8\t3" for k in range(9) for kind in SENSORS]
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "good.txt").write_text("\n".join(rows) + "\n")
    (tmp_path / "logs" / "bad.txt").write_text("nothing of use\n")
    code, out, err = elfslam("import", "mall", tmp_path / "logs", tmp_path / "walks", "--json")
    assert code == 1
    assert json.loads(out)[0]["recordings"] == 1
    assert "bad.txt" in err
    assert [item.name for item in (tmp_path / "walks").iterdir()] == ["good"]


@pytest.mark.parametrize("log_format", LOGS)
def test_a_log_is_read_as_it_is(log_format: LogFormat, tmp_path: Path, elfslam: Elfslam) -> None:
    (tmp_path / "log").mkdir()
    for name, text in LOGS[log_format]().items():
        file = tmp_path / "log" / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    alone = log_format is LogFormat.GETSENSORDATA
    log = tmp_path / "log" / "walk.txt" if alone else tmp_path / "log"
    code, out, err = elfslam("import", "auto", log, tmp_path / "walk", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)[0] == {"format": log_format, "recordings": 1, "damaged_lines": 0}
    assert read_recording(tmp_path / "walk").imu is not None


def test_what_was_noted_at_the_import_is_said_there_and_by_every_map(
    tmp_path: Path, elfslam: Elfslam
) -> None:
    log, walk, run = packed(put_back(60), tmp_path / "log.zip"), tmp_path / "walk", tmp_path / "run"
    said = "the clock was put back by 59.99 s at 7.99 s"
    code, _, err = elfslam("import", "auto", log, walk)
    assert (code, err.count("\n")) == (0, 1)
    assert err.startswith(f"log: {said}")
    assert said in elfslam("map", walk, run, "--by", "motion")[2]
    assert json.loads((run / "run.json").read_text())["notes"][0].startswith(said)


QUICK = tuple(
    word
    for setting in ("steps=12", "check_steps=4", "warmup_steps=2", "learning_rate=1e-3",
                    "pairs=48", "shortest_s=30", "threads=1")
    for word in ("--set", f"finetune.{setting}")
)  # fmt: skip


@pytest.mark.real
def test_an_encoder_learns_a_walk(walk: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    files = [tmp_path / "new" / name for name in ("one.onnx", "two.onnx")]
    shipped = load_encoder("compact").content
    for file in files:
        code, out, err = elfslam("finetune", walk, file, "--seed", 3, *QUICK)
        assert (code, out) == (0, "")
        assert "revisits heard again" in err
        assert (file.read_bytes() == shipped) == ("does not help" in err)
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.real
def test_a_map_takes_its_tuned_encoder_along(walk: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    run = tmp_path / "run"
    code, _, err = elfslam("map", walk, run, "--finetune", *QUICK)
    assert code == 0
    facts = json.loads((run / "run.json").read_text())
    assert f"fine-tuning: {facts['finetuning']}" in err
    assert load_encoder(str(run / "encoder.onnx")).identity == facts["encoder"]
    kept = facts["encoder"] == load_encoder("compact").identity
    assert kept == ("does not help" in facts["finetuning"])
    assert elfslam("locate", walk, run, tmp_path / "fixes.csv")[0] == 0


def test_the_card_of_an_encoder_is_printed(tmp_path: Path, elfslam: Elfslam) -> None:
    file = tmp_path / "one.onnx"
    tiny = ("steps=2", "pairs=4", "rooms=2", "width=4", "warmup_steps=1", "component_batches=0")
    settings = [word for setting in tiny for word in ("--set", f"pretrain.{setting}")]
    assert elfslam("pretrain", file, "--seed", 5, *settings)[0] == 0
    code, out, _ = elfslam("card", file, "--json")
    shown = {row["what"]: row["value"] for row in json.loads(out)}
    assert (code, shown["seed"], shown["echoes"]) == (0, 5, 16)
    assert shown["parameters"]["width"] == 4
    assert "samples (n, 2352)" in shown["Input"]
    code, out, _ = elfslam("card", file)
    assert code == 0
    assert "parameters_digest" in out


def elf_results(method: str, value: str = "0.7", study: str = "elf") -> str:
    """Results of a study about one encoder, all figures the same."""
    return "".join(f"{study},hall,{method},1 footstep,{metric},{value}\n" for metric in ON_THE_CARD)


def test_figures_of_a_study_go_on_a_card(tmp_path: Path, elfslam: Elfslam) -> None:
    table, out = tmp_path / "elf.csv", tmp_path / "measured.onnx"
    head = "study,world,method,condition,metric,value\n"
    table.write_text(head + elf_results("compact"))
    assert elfslam("card", "--measured", table, "--out", out)[0] == 0
    shown = {each["what"]: each["value"] for each in json.loads(elfslam("card", out, "--json")[1])}
    assert shown["recall at 1 % false positives, 1 footstep, hall"] == 0.7
    for text, refused in (
        (elf_results("compact") + elf_results("PSD"), "got PSD, compact"),
        (elf_results("compact", study="laps"), "got another study"),
        ("", "got none"),
        (elf_results("compact", value="good"), "good is no number"),
    ):
        table.write_text(head + text)
        code, _, err = elfslam("card", "--measured", table, "--out", tmp_path / "no.onnx")
        assert (code, (tmp_path / "no.onnx").exists()) == (2, False)
        assert refused in err.replace("'", "")
    table.write_text("study,method\n")
    code, _, err = elfslam("card", "--measured", table, "--out", tmp_path / "no.onnx")
    assert "column world is missing" in err
    code, _, err = elfslam("card", "--measured", table)
    assert code == 2
    assert "go together" in err


def test_an_encoder_without_a_card_is_told_in_one_line(elfslam: Elfslam) -> None:
    code, out, err = elfslam("card", "spectral")
    assert (code, out) == (1, "")
    assert err == "elfslam: encoder spectral: carries no card, so how it was made is not known\n"


def test_a_real_magnetic_walk_mends(shared_data: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    recording, run = tmp_path / "eight", tmp_path / "run"
    elfslam("import", "magnetic", shared_data / "magnetic" / "eight.mat", recording)
    assert elfslam("map", recording, run, "--by", "magnetic")[0] == 0
    rows = json.loads(elfslam("score", run, recording, "--json")[1])
    rmse = {(row["method"], row["alignment"]): row["rmse_m"] for row in rows}
    assert rmse["SLAM", "aligned"] < 0.8 * rmse["dead reckoning", "aligned"]


@pytest.mark.real
def test_real_mall_walks_are_reckoned(shared_data: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    """Every tenth of a floor."""
    with tarfile.open(shared_data / "mall_walks" / "site1-F1.tar.xz") as archive:
        texts = [each for each in archive if each.name.endswith(".txt")][::10]
        archive.extractall(tmp_path / "logs", texts, filter="data")
    code, out, _ = elfslam("import", "mall", tmp_path / "logs", tmp_path / "walks", "--json")
    told = json.loads(out)[0]
    assert (code, told["recordings"], told["damaged_lines"]) == (0, len(texts), 0)
    assert elfslam("map", tmp_path / "walks", tmp_path / "runs")[0] == 0
    rows = json.loads(elfslam("score", tmp_path / "runs", tmp_path / "walks", "--json")[1])
    assert {row["method"] for row in rows} == {"dead reckoning"}
    assert (rows[0]["measure"], rows[0]["walks"]) == ("end_error_percent", len(texts))
    assert rows[0]["median"] < 15.0


@pytest.fixture
def lap(tmp_path: Path) -> Path:
    """The map of one lap of 6 x 4 m."""
    xy_m = resampled(np.array([[0.0, 0], [6, 0], [6, 4], [0, 4], [0, 0]]), 0.2)
    count = len(xy_m)
    spread = np.tile(0.01 * np.eye(2), (count, 1, 1))
    order = np.arange(count)
    floor = FloorMap(xy_m, np.zeros(count), np.zeros(count), order, spread, (), "", ("lap",))
    write_map(floor, tmp_path / "lap.npz")
    return tmp_path / "lap.npz"


def test_what_an_export_must_be_told_is_asked(lap: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    for told, words in (
        ((), "such as 47.3769,8.5417,90 (--origin)"),
        (("--origin", "here"), "origin 'here': wanted LAT,LON"),
        (("--origin", "47,8", "--place", tmp_path / "no.toml"), "no.toml: cannot be read"),
    ):
        code, _, err = elfslam("export", lap, tmp_path / "out", "--to", "imdf", *told)
        assert (code, err.count("\n")) == (2, 1)
        assert words in err
    told = ("--to", "geojson", "--origin", "47,8")
    assert elfslam("export", lap, tmp_path / "m.geojson", *told)[0] == 0


def room_picture(folder: Path, height: int, width: int, wall: int) -> Path:
    """The plan of one room, as a picture."""
    pixels = np.zeros((height, width), dtype=np.uint8)
    pixels[wall:-wall, wall:-wall] = 255
    Image.fromarray(pixels).save(folder / "plan.png")
    return folder / "plan.png"


def test_a_run_is_placed_on_a_plan_or_not(lap: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    image, out = room_picture(tmp_path, 80, 100, 5), tmp_path / "out"
    quick = ("--set", "anchoring.cell_m=0.3")
    for plan, more, refused, words in (
        (image, (), 2, "width in metres"),
        (f"{image}:3", quick, 1, "off accessible ground"),
        (f"{image}:60", quick, 1, "in several ways"),
        (f"{image}:60", ("--start", "door"), 2, "--start 'door'"),
    ):
        code, _, err = elfslam("anchor", lap, plan, out, *more)
        assert (code, words in err, out.exists()) == (refused, True, False)
    code, _, err = elfslam("anchor", lap, f"{image}:9.2", out, "--start", "1.6,1.6")
    assert (code, "probability" in err) == (0, True)
    assert (out / "map.npz").is_file()


def test_a_run_follows_a_plan_or_does_not(mapped: Path, tmp_path: Path, elfslam: Elfslam) -> None:
    plan, out = f"{room_picture(tmp_path, 100, 100, 2)}:30", tmp_path / "out"
    quick = ("--follow", "--set", "map_matching.particles=500")
    unplaced = ("15,15", 2, "say the heading"), ("-40,40,0", 1, "leaves the ground")
    for start, refused, words in unplaced:
        code, _, err = elfslam("anchor", mapped, plan, out, *quick, "--start", start)
        assert (code, words in err, out.exists()) == (refused, True, False)
    code, _, err = elfslam("anchor", mapped, plan, out, *quick, "--start", "15,15,0")
    assert (code, "followed through the plan" in err) == (0, True)
    there, before = read_map(out), read_map(mapped)
    assert np.abs(there.xy_m - before.xy_m - 15).max() < 4
    assert there.payloads[0].encoder == before.payloads[0].encoder
    assert (out / "followed.tum").is_file()
    code, _, err = elfslam("anchor", out, plan, tmp_path / "again", *quick)
    assert (code, "only a walk with its footsteps" in err) == (2, True)
