"""Nothing half-written stays, nothing else is overwritten, and what a kill left is mended."""

import errno
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from killed import survives

from elfslam.app.anchor import ANCHOR, FOLLOWED
from elfslam.base.errors import StoreError
from elfslam.data import atomic_files
from elfslam.data.atomic_files import new_file, new_folder, refuse_read, settled, sha256_of
from elfslam.data.map_files import FACTS, MERGED
from elfslam.data.recordings import MANIFEST
from elfslam.serve.store.opening import STORE
from tests.disks import mounted


def _half_written_folder(folder: Path) -> None:
    with new_folder(folder) as partial:
        (partial / "a").write_text("x")
        raise KeyboardInterrupt


def _half_written_file(file: Path) -> None:
    with new_file(file, overwrite=True) as partial:
        partial.write_text("half")
        raise ZeroDivisionError


def refuse(words: str, new: Callable[..., Any], place: Path, **how: Any) -> None:
    """Nothing may be written there, which is said before the work is begun."""
    with pytest.raises(StoreError, match=words), new(place, **how):
        raise AssertionError("the work was begun")


def test_a_folder_appears_whole(tmp_path: Path) -> None:
    wanted = tmp_path / "deep" / "new"
    with new_folder(wanted) as partial:
        (partial / "a").write_text("x")
        assert not wanted.exists()
    assert list(tmp_path.rglob("a")) == [wanted / "a"]


def test_an_empty_folder_may_be_filled(tmp_path: Path) -> None:
    (tmp_path / "new").mkdir()
    with new_folder(tmp_path / "new") as partial:
        (partial / "a").write_text("x")
    assert (tmp_path / "new" / "a").is_file()
    assert len(list(tmp_path.iterdir())) == 1


def test_a_file_in_the_way_is_kept(tmp_path: Path) -> None:
    (tmp_path / "new").write_text("precious")
    refuse("already exists", new_folder, tmp_path / "new")
    refuse("already exists", new_file, tmp_path / "new")
    refuse("cannot be written", new_folder, tmp_path / "new" / "b")
    refuse("cannot be written", new_file, tmp_path / "new" / "b")
    assert (tmp_path / "new").read_text() == "precious"


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    file = tmp_path / "fixes.csv"
    file.write_text("old")
    with pytest.raises(ZeroDivisionError):
        _half_written_file(file)
    assert file.read_text() == "old"
    with new_file(file, overwrite=True) as partial:
        partial.write_text("new")
    assert file.read_text() == "new"
    assert list(tmp_path.iterdir()) == [file]


def test_a_file_that_came_first_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "fixes.csv"

    def late(partial: Path) -> None:
        partial.write_text("mine")
        file.write_text("theirs")

    with pytest.raises(StoreError, match="already exists"), new_file(file) as partial:
        late(partial)
    assert file.read_text() == "theirs"
    assert list(tmp_path.iterdir()) == [file]


def test_a_file_that_became_part_of_a_run_is_kept(tmp_path: Path) -> None:
    def late(partial: Path) -> None:
        partial.write_text("mine")
        (tmp_path / "run.json").write_text("{}")
        (tmp_path / "map.npz").write_text("theirs")

    with (
        pytest.raises(StoreError, match=r"map\.npz: belongs to a run"),
        new_file(tmp_path / "map.npz", overwrite=True) as partial,
    ):
        late(partial)
    assert (tmp_path / "map.npz").read_text() == "theirs"


def test_without_hard_links_it_is_renamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(source: Path, target: Path) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", refused)
    with new_file(tmp_path / "fixes.csv") as partial:
        partial.write_text("new")
    assert (tmp_path / "fixes.csv").read_text() == "new"
    refuse("already exists", new_file, tmp_path / "fixes.csv")


@pytest.mark.parametrize(
    "marker", [MANIFEST, FACTS, MERGED, ANCHOR, FOLLOWED, f"../{STORE}"], ids=os.path.basename
)
def test_files_of_recordings_runs_maps_and_servers_are_kept(tmp_path: Path, marker: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "audio.flac").write_text("precious")
    (folder / marker).write_text("{}")
    (tmp_path / "link").symlink_to(folder / "audio.flac")
    for out in (folder / "audio.flac", tmp_path / "link"):
        refuse("belongs to", new_file, out, overwrite=True)
    assert (folder / "audio.flac").read_text() == "precious"


def test_what_is_read_is_never_replaced(tmp_path: Path) -> None:
    for folder in ("map", "run"):
        (tmp_path / folder / "deep").mkdir(parents=True)
        (tmp_path / folder / "deep" / "walk").write_text("precious")
    (tmp_path / "run" / "run.json").write_text("{}")
    source = tmp_path / "map" / "deep" / "walk"
    (tmp_path / "link").symlink_to(source)
    (tmp_path / "hard").hardlink_to(source)
    (tmp_path / "other").write_text("free")
    for out, read in (
        (source, source), (tmp_path / "link", source), (tmp_path / "hard", source),
        (source, tmp_path / "link"), (source, tmp_path / "map"),
    ):  # fmt: skip
        refuse("is read", new_file, out, overwrite=True, reads=[read])
    with pytest.raises(StoreError, match="is read"):
        refuse_read(tmp_path / "run", [tmp_path / "run" / "deep" / "walk"])
    refuse_read(tmp_path / "map", [source])  # no result, so nothing replaces it
    refuse_read(tmp_path / "other", [source, tmp_path / "missing"])
    assert source.read_text() == "precious"


NOWHERE = ("", "./", "../..", "/", "{here}", "{here}/..", "below/..")


@pytest.mark.parametrize("out", NOWHERE)
@pytest.mark.parametrize("new", [new_folder, new_file])
def test_the_current_folder_and_those_above_are_no_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, new: Callable[[Path], Any], out: str
) -> None:
    monkeypatch.chdir(tmp_path)
    refuse("is the current folder or one above it", new, Path(out.format(here=tmp_path)))
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_its_own_is_replaced_and_a_link_there_is_not_followed(tmp_path: Path) -> None:
    own, foreign = tmp_path / "own", tmp_path / "foreign"
    own.mkdir()
    foreign.write_text("precious")
    (own / "run.json").write_text("{}")
    (own / "score.html").symlink_to(foreign)
    for text in ("one", "two"):
        with atomic_files.replaced_file(own / "score.html") as partial:
            partial.write_text(text)
        assert (own / "score.html").read_text() == text
    assert foreign.read_text() == "precious"
    assert sorted(os.listdir(own)) == ["run.json", "score.html"]


def test_an_error_about_another_file_is_not_one_of_the_place(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="missing"), new_file(tmp_path / "out"):
        (tmp_path / "missing").read_bytes()
    with pytest.raises(StoreError, match="out: cannot be written"), new_file(tmp_path / "out"):
        pass
    with (
        pytest.raises(StoreError, match=r"out: cannot be written \(No space"),
        new_file(tmp_path / "out"),
    ):
        raise OSError(errno.ENOSPC, "No space left on device", "source")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_file_is_not_replaced_by_one(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for place in (tmp_path, tmp_path / "pipe"):
        refuse("is no file that", new_file, place)
    assert (tmp_path / "pipe").is_fifo()


def test_a_link_stays_and_what_it_names_is_written(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    for name in ("folder", "file"):
        (tmp_path / name).symlink_to(tmp_path / "there" / name)
    with new_folder(tmp_path / "folder") as partial:
        (partial / "a").write_text("x")
    with new_file(tmp_path / "file") as partial:
        partial.write_text("y")
    assert (tmp_path / "there" / "folder" / "a").read_text() == "x"
    assert (tmp_path / "there" / "file").read_text() == "y"
    assert (tmp_path / "folder").is_symlink()


def test_folders_made_on_the_way_go_with_what_failed(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        _half_written_folder(tmp_path / "a" / "b" / "new")
    with pytest.raises(ZeroDivisionError):
        _half_written_file(tmp_path / "a" / "c" / "new")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("new", [new_folder, new_file])
def test_two_never_write_at_one_place(tmp_path: Path, new: Callable[[Path], Any]) -> None:
    with new(tmp_path / "out") as partial:
        refuse("out: somebody else is writing", new, tmp_path / "out")
        if new is new_file:
            partial.write_text("first")
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("replaces", [None, "mark"])
def test_what_somebody_made_meanwhile_is_kept(tmp_path: Path, replaces: str | None) -> None:
    out = tmp_path / "out"

    def write() -> None:
        with new_folder(out, replaces=replaces) as partial:
            (partial / "mark").write_text("mine")
            out.mkdir()
            (out / "thesis.txt").write_text("theirs")

    with pytest.raises(StoreError, match=r"out: (already exists|holds no mark)"):
        write()
    assert [item.name for item in out.iterdir()] == ["thesis.txt"]
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


def test_what_is_renamed_away_holds_what_it_must(tmp_path: Path) -> None:
    """The older result became something else while the new one was made."""
    out = tmp_path / "out"
    made(out, "old")

    def write() -> None:
        with new_folder(out, replaces="mark") as partial:
            (partial / "mark").write_text("new")
            (out / "mark").rename(out / "thesis.txt")

    with pytest.raises(StoreError, match="holds no mark"):
        write()
    assert (out / "thesis.txt").read_text() == "old"


def test_it_lasts_before_it_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All that is in it reaches the disk before the name does, and the name before the end."""
    done: list[str] = []
    sync, rename = os.fsync, os.rename

    def note_sync(descriptor: int) -> None:
        done.append(os.path.relpath(os.readlink(f"/proc/self/fd/{descriptor}"), tmp_path))
        sync(descriptor)

    def note_rename(source: Path, target: Path) -> None:
        done.append(f"rename {target.name}")
        rename(source, target)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(os, "rename", note_rename)
    with new_folder(tmp_path / "out") as partial:
        (partial / "deep").mkdir()
        for name in ("a", "deep/b"):
            (partial / name).write_text("x")
    at = done.index("rename out")
    inside = {".out.partial", ".out.partial/a", ".out.partial/deep", ".out.partial/deep/b"}
    assert inside <= set(done[:at])
    assert "." in done[at:]


def made(out: Path, what: str, replaces: str | None = "mark") -> None:
    """A result of three files, by default in the place of the older one."""
    with new_folder(out, replaces=replaces) as partial:
        (partial / "deep").mkdir()
        for name in ("mark", "a", "deep/b"):
            (partial / name).write_text(what)


def written_by(out: Path, what: Sequence[str], replaces: str | None) -> list[str]:
    """What of this was written where each is written by a process of its own, all at once."""
    read, write = os.pipe()
    children = []
    for each in what:
        if (child := os.fork()) == 0:
            os.close(write)
            os.read(read, 1)  # all begin when the last has been started
            os._exit(wrote(out, each, replaces))
        children.append(child)
    os.close(write)
    ended = [os.waitpid(child, 0)[1] for child in children]
    os.close(read)
    return [each for each, status in zip(what, ended, strict=True) if status == 0]


def wrote(out: Path, what: str, replaces: str | None) -> int:
    """The exit code of a process that writes."""
    try:
        made(out, what, replaces)
    except StoreError:
        return 2
    return 0


@pytest.mark.parametrize("replaces", [None, "mark"])
def test_of_several_at_once_one_is_seen(tmp_path: Path, replaces: str | None) -> None:
    for turn in range(4):
        out = tmp_path / str(turn) / "out"
        done = written_by(out, ["a", "b", "c", "d"], replaces)
        [whole] = seen(out)
        assert whole in done
        assert replaces or len(done) == 1
        assert [item.name for item in out.parent.iterdir()] == ["out"]


def seen(out: Path) -> set[str]:
    """What the files of a result say: one thing where it is whole."""
    return {(out / name).read_text() for name in ("mark", "a", "deep/b")}


def test_a_replacement_killed_at_any_step_is_finished_or_taken_back(tmp_path: Path) -> None:
    """Whatever looks there next finds the old or the new result whole; and nothing is left over."""
    found = []
    for step in range(200):
        out = tmp_path / str(step) / "out"
        made(out, "old")
        if survives(step, lambda out=out: made(out, "new")):
            break
        [whole] = seen(settled(out))
        found.append(whole)
        made(out, "newest")
        assert seen(out) == {"newest"}
        assert [item.name for item in out.parent.iterdir()] == ["out"]
    assert len(found) > 30
    assert found == sorted(found, reverse=True), "old until some step, new from then on"
    assert set(found) == {"old", "new"}


def test_a_first_result_killed_at_any_step_leaves_nothing_for_ever(tmp_path: Path) -> None:
    for step in range(200):
        out = tmp_path / str(step) / "out"
        if survives(step, lambda out=out: made(out, "new")):
            break
        assert not out.exists() or seen(out) == {"new"}
        made(out, "newest")
        assert [item.name for item in out.parent.iterdir()] == ["out"]
    assert step > 20


def test_a_file_killed_at_any_step_is_old_or_new(tmp_path: Path) -> None:
    def write(file: Path, text: str) -> None:
        with new_file(file, overwrite=True) as partial:
            partial.write_text(text)

    for step in range(100):
        file = tmp_path / str(step) / "file"
        write(file, "old")
        if survives(step, lambda file=file: write(file, "new")):
            break
        assert file.read_text() in ("old", "new")
        write(file, "newest")
        assert [item.name for item in file.parent.iterdir()] == ["file"]
    assert step > 8


def test_a_kill_between_both_renames_is_seen_before_the_work(tmp_path: Path) -> None:
    """Whoever asks whether the place is free hears that the older result is there again."""
    out = tmp_path / "out"
    made(out, "old")
    out.rename(tmp_path / ".out.replaced")
    with pytest.raises(StoreError, match="already exists"):
        atomic_files.refuse_occupied(out, None)
    assert seen(out) == {"old"}
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    """A file system that nobody may write to, root included; skips where none may be mounted."""
    with mounted(tmp_path / "disk", ro="") as place:
        yield place


@pytest.mark.parametrize("new", [new_folder, new_file])
def test_a_read_only_place_is_named(read_only: Path, new: Callable[[Path], Any]) -> None:
    for place in (read_only / "out", read_only / "deep" / "out"):
        said = rf"{place}: cannot be written \(Read-only file system\)"
        refuse(said, new, place)


def test_the_digest_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "abc"
    file.write_bytes(b"abc")
    # The first example of FIPS 180-4.
    assert sha256_of(file) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
