"""Arrays come back as they were written; what claims another size than it has is refused."""

import io
import tracemalloc
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from elfslam.base import bounds
from elfslam.base.errors import StoreError
from elfslam.data.npz import LARGEST, read_npz, write_npz

DTYPES = st.one_of(
    arrays.boolean_dtypes(),
    arrays.integer_dtypes(endianness="="),
    arrays.floating_dtypes(endianness="="),
    arrays.unicode_string_dtypes(endianness="=", min_len=3),
)
TEXTS = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=3)


def npy(array: object) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def header(told: str, content: bytes = b"") -> bytes:
    """A .npy with any header."""
    text = told.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + content


def claim(shape: str, descr: str = "<f8") -> str:
    return f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}"


def stored(folder: Path, content: bytes) -> Path:
    with zipfile.ZipFile(folder / "a.npz", "w") as archive:
        archive.writestr("x.npy", content)
    return folder / "a.npz"


def refusal(path: Path) -> str:
    with pytest.raises(StoreError) as refused:
        read_npz(path, ["x"])
    said = str(refused.value)
    assert said.startswith(f"{path}: is missing or damaged")
    assert "\n" not in said
    return said


@settings(max_examples=40)
@given(st.data())
def test_arrays_come_back(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    dtype = data.draw(DTYPES)
    shape = data.draw(arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4))
    elements = TEXTS if dtype.kind == "U" else None
    made = data.draw(arrays.arrays(dtype, shape, elements=elements))
    assume(dtype.kind in "bU" or not ((made > LARGEST) | (made < -LARGEST)).any())
    file = tmp_path_factory.getbasetemp() / "law.npz"
    write_npz(file, {"x": made, "y": np.asarray(made, order="F")})
    found = read_npz(file, ["x", "y"])
    assert set(found) == {"x", "y"}
    for name, came in found.items():
        assert came.dtype == made.dtype, name
        assert came.shape == made.shape
        assert came.tobytes() == made.tobytes()


@pytest.mark.parametrize("shape", ["(1000000000000,)", "(0, 1000000000000000)", f"({2**40}, 2)"])
def test_a_claim_is_refused_before_anything_is_made(tmp_path: Path, shape: str) -> None:
    path = stored(tmp_path, header(claim(shape)))
    tracemalloc.start()
    try:
        assert "claims" in refusal(path)
        assert tracemalloc.get_traced_memory()[1] < 2**22
    finally:
        tracemalloc.stop()


def test_a_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounds, "FREE_BYTES", 2**20)
    size = 2**22
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", header(claim(f"({size},)", "<u1"), bytes(size)))
    assert "claims" in refusal(tmp_path / "a.npz")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x93NUMPY\x09\x00" + bytes(20),
        b"\x93NUMPY\x02\x00\xff\xff\xff\xff",
        npy(np.arange(5))[:-1],
        npy(np.arange(5)) + b"x",
        npy(np.array([{}])),
        npy(np.zeros(2, dtype="i4,f8")),
        npy(np.array([1.0, -1e16])),
        npy(np.array([-(2**63)])),
        npy(np.zeros(2, dtype="c16")),
        header(claim("(3,)"), bytes(16)),
        header(claim("(-1,)"), b""),
        header(claim("(2,)", "<f9"), bytes(18)),
        header(claim("(" * 5000 + ")" * 5000)),
        header("{'descr': '<f8' 'fortran_order'(1): False}"),
        header("-" * 9000 + "1"),
        header(claim("(1,)", "<U1"), b"\xff\xff\xff\xff"),
        header(claim("(1,)", "<U1"), b"\x00\xd8\x00\x00"),
        header(claim("(5000000,)", "<U1"), bytes(20_000_000)),
    ],
)
def test_what_is_no_array_is_refused_without_another_word(tmp_path: Path, content: bytes) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert refusal(stored(tmp_path, content))


def test_a_file_of_one_array_has_no_names(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(npy(np.zeros(3)))
    assert "not whole" in refusal(tmp_path / "a.npz")
    write_npz(tmp_path / "a.npz", {"y": np.zeros(3)})
    with pytest.raises(StoreError, match="lacks the array x"):
        read_npz(tmp_path / "a.npz", ["x"])
