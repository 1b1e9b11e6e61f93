"""Archives from outside: texts come out, what is hostile is refused before any does."""

import io
import lzma
import tarfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elfslam.base import bounds
from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.data import log_files
from elfslam.data.sensor_files import gravity_in


def entry(name: str, kind: bytes = tarfile.REGTYPE, **more: object) -> tarfile.TarInfo:
    made = tarfile.TarInfo(name)
    made.type = kind
    for key, value in more.items():
        setattr(made, key, value)
    return made


def packed(folder: Path, *entries: tuple[tarfile.TarInfo, bytes]) -> Path:
    path = folder / "a.tar.xz"
    with tarfile.open(path, "w:xz") as archive:
        for info, content in entries:
            info.size = info.size or len(content)
            archive.addfile(info, io.BytesIO(content))
    return path


def test_texts_come_out_in_their_order(tmp_path: Path) -> None:
    path = packed(
        tmp_path,
        (entry("site", tarfile.DIRTYPE), b""),
        (entry("site/b.txt"), b"two"),
        (entry("site/info.json"), b"{}"),
        (entry("../a.txt"), b"one"),
    )
    log_files.check_archive(path)
    assert list(log_files.texts_in(path)) == [("b.txt", b"two"), ("a.txt", b"one")]


KINDS = {
    "device": (tarfile.CHRTYPE, {"devmajor": 1, "devminor": 5}),
    "disk": (tarfile.BLKTYPE, {"devmajor": 8}),
    "pipe": (tarfile.FIFOTYPE, {}),
    "link": (tarfile.SYMTYPE, {"linkname": "/etc/passwd"}),
    "hard link": (tarfile.LNKTYPE, {"linkname": "b.txt"}),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_plain_file_is_refused(tmp_path: Path, kind: str) -> None:
    told, more = KINDS[kind]
    path = packed(tmp_path, (entry("b.txt"), b"x"), (entry("a.txt", told, **more), b""))
    with pytest.raises(InputError, match="no plain file"):
        log_files.check_archive(path)


def test_an_archive_without_texts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no walk"):
        log_files.check_archive(packed(tmp_path, (entry("a.json"), b"{}")))
    with pytest.raises(InputError, match="holds no walk"):
        log_files.check_archive(packed(tmp_path))


def test_bombs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free_bytes = 2**20
    for module in (bounds, log_files):
        monkeypatch.setattr(module, "FREE_BYTES", free_bytes)
    with pytest.raises(InputError, match="claims"):
        log_files.check_archive(packed(tmp_path, (entry("a.txt"), bytes(free_bytes * 2))))
    several = [(entry(f"{k}.txt"), bytes(free_bytes // 2)) for k in range(4)]
    with pytest.raises(InputError, match="more than can be believed"):
        log_files.check_archive(packed(tmp_path, *several))
    head = entry("a.txt", tarfile.XHDTYPE, size=4 * free_bytes).tobuf(tarfile.USTAR_FORMAT)
    (tmp_path / "a.tar.xz").write_bytes(lzma.compress(head + bytes(4 * free_bytes), preset=0))
    with pytest.raises(InputError, match="more than can be believed"):
        log_files.check_archive(tmp_path / "a.tar.xz")


def test_countless_entries_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("elfslam.data.log_files.MOST_MEMBERS", 3)
    path = packed(tmp_path, *[(entry(f"{k}.txt"), b"x") for k in range(4)])
    with pytest.raises(InputError, match="more than 3 entries"):
        log_files.check_archive(path)


PERIOD_S = 0.01
TRUE_S = np.arange(3000) * PERIOD_S
GRAVITY_MPS2 = np.array([0.5, 4.0, 8.9])
jumps = st.lists(
    st.tuples(st.integers(50, 2950), st.floats(0.5, 7200)), min_size=0, max_size=4
).filter(lambda found: all(b[0] - a[0] > 50 for a, b in pairwise(sorted(found))))


def written(t_s: F64, put_back: list[tuple[int, float]]) -> F64:
    """Times as a clock writes them that is put back at rows, by seconds."""
    shown = t_s.copy()
    for row, back_s in put_back:
        shown[t_s >= TRUE_S[row] - 1e-9] -= back_s
    return shown


@settings(max_examples=30)
@given(jumps)
def test_a_clock_put_back_loses_no_row_and_tells_jumps(put_back: list[tuple[int, float]]) -> None:
    clock = log_files.clock_of("walk", written(TRUE_S, put_back))
    npt.assert_allclose(clock.running(written(TRUE_S, put_back)), TRUE_S, atol=1e-6)
    assert len(clock.notes) == len(put_back)
    assert all("was put back by" in note for note in clock.notes)


@settings(max_examples=30)
@given(jumps, st.floats(0, 0.009), st.sampled_from([1, 2, 5]))
def test_every_stream_of_a_log_is_put_right_by_the_densest(
    put_back: list[tuple[int, float]], late_s: float, every: int
) -> None:
    """They jump at one instant, and each of them shows it in rows of its own."""
    clock = log_files.clock_of("walk", written(TRUE_S, put_back))
    other_s = TRUE_S[::every] + late_s
    gyroscope = written(other_s, put_back), other_s[:, None]
    streams, left_out = log_files.on_one_clock({"gyroscope": gyroscope}, clock)
    t_s, values = streams["gyroscope"]
    assert left_out == 0
    npt.assert_allclose(t_s, values[:, 0], atol=1e-6)
    assert len(t_s) == len(other_s)


def test_a_sparse_stream_is_put_right_though_it_never_goes_backward() -> None:
    put_back = [(2000, 3600.0)]
    clock = log_files.clock_of("walk", written(TRUE_S, put_back))
    for taps_s in ([24.0], [4.0, 14.0, 24.0], [21.0, 22.0]):
        shown = written(np.array(taps_s), put_back)
        npt.assert_allclose(clock.running(shown), taps_s, atol=1e-6)


@pytest.mark.parametrize("count", [1, 3, log_files.MOST_DAMAGED_ROWS])
@pytest.mark.parametrize("wrong_s", [900.0, -50.0, 0.004])
def test_a_few_rows_that_leap_and_come_back_are_damage(count: int, wrong_s: float) -> None:
    shown = TRUE_S.copy()
    shown[1000 : 1000 + count] = wrong_s
    clock = log_files.clock_of("walk", shown)
    streams, left_out = log_files.on_one_clock({"a": (shown, TRUE_S[:, None])}, clock)
    assert (clock.notes, left_out) == ((), count)
    npt.assert_array_equal(*streams["a"][:1], streams["a"][1][:, 0])


def test_a_restart_of_the_clock_at_zero_goes_on_a_sample_later() -> None:
    shown = np.concatenate([TRUE_S[:1500], TRUE_S[:1500]])
    clock = log_files.clock_of("walk", shown)
    npt.assert_allclose(clock.running(shown), TRUE_S, atol=1e-9)
    assert clock.notes == (
        "the clock was put back by 14.99 s at 14.99 s; what follows is kept, 0.010 s behind what "
        "came before",
    )


def test_a_long_step_ahead_is_a_gap_that_is_told() -> None:
    shown = TRUE_S + 3600.0 * (TRUE_S >= 20)
    clock = log_files.clock_of("walk", shown)
    npt.assert_array_equal(clock.running(shown), shown)
    assert clock.notes[0].startswith("nothing was measured for 3600.0 s from 19.99 s on")


def test_times_that_are_no_clock_are_refused_at_once() -> None:
    shown = np.random.default_rng(0).uniform(0, 1000, 20_000)
    with pytest.raises(InputError, match=f"walk: .* put back over {log_files.MOST_JUMPS} times"):
        log_files.clock_of("walk", shown)


def walking(gravity: F64, *, pushed: bool = True) -> log_files.Stream:
    """Steps that no second is a multiple of, each a push along all axes, and a slow sway."""
    beat = 4.0 * np.sin(2 * np.pi * 1.7 * TRUE_S) + 1.2 * np.sin(2 * np.pi * 0.3 * TRUE_S)
    push = beat[:, None] * np.array([0.4, 0.5, 0.8])
    return TRUE_S, np.tile(gravity, (len(TRUE_S), 1)) + push * pushed


WHOLE, LINEAR = walking(GRAVITY_MPS2), walking(np.zeros(3))
NOISY = TRUE_S, WHOLE[1] - LINEAR[1] * 1.05
"""Gravity as a phone reckons it, with a little of the steps in it."""
ALONE = walking(GRAVITY_MPS2, pushed=False)


@pytest.mark.parametrize(
    "streams", [[WHOLE], [LINEAR, WHOLE], [LINEAR, ALONE], [ALONE, LINEAR], [ALONE, WHOLE]]
)
@pytest.mark.parametrize("unit_mps2", [1.0, None])
def test_gravity_and_steps_are_found_wherever_they_are(
    streams: list[log_files.Stream], unit_mps2: float | None
) -> None:
    npt.assert_allclose(log_files.with_gravity(streams, unit_mps2)[1], WHOLE[1], atol=1e-9)


@pytest.mark.parametrize("strength", [0.1, 1.3, 8.0])
@pytest.mark.parametrize("unit_mps2", [1.0, None])
def test_acceleration_of_no_gravity_is_unscaled(strength: float, unit_mps2: float | None) -> None:
    """However strong its steps: those of a median of 1 are no g, those of 9.8 no gravity."""
    t_s, steps = LINEAR
    felt = log_files.with_gravity([(t_s, strength * steps)], unit_mps2)[1]
    npt.assert_array_equal(felt, strength * steps)
    assert gravity_in(t_s, strength * steps) == 0


def test_gravity_that_is_not_quite_steady_is_still_gravity_alone() -> None:
    found = log_files.with_gravity([LINEAR, NOISY], 1.0)[1]
    npt.assert_allclose(found, LINEAR[1] + NOISY[1], atol=1e-9)


def test_a_unit_is_found_by_gravity_only_where_none_is_stated() -> None:
    t_s, in_g = WHOLE[0], WHOLE[1] / log_files.STANDARD_GRAVITY_MPS2
    npt.assert_allclose(log_files.with_gravity([(t_s, in_g)])[1], WHOLE[1], atol=1e-9)
    npt.assert_array_equal(log_files.with_gravity([(t_s, in_g)], 1.0)[1], in_g)
