"""Wi-Fi rows and matrices."""

import tracemalloc
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base.errors import InputError
from elfslam.data.sensor_files import read_wifi, scans_from_rows, write_wifi

FILE = Path("wifi.csv")


def test_rows_of_one_time_make_one_scan() -> None:
    wifi = scans_from_rows(FILE, [2.0, 1.0, 1.0], ["b", "b", "a"], [-40, -50, -60], [0.1, 0.2, 0.3])
    assert wifi.bssids == ("a", "b")
    assert wifi.t_s.tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(wifi.rssi_dbm, [[-60, -50], [np.nan, -40]])
    np.testing.assert_array_equal(wifi.age_s, [[0.3, 0.2], [np.nan, 0.1]])


def test_an_age_may_be_unknown(tmp_path: Path) -> None:
    file = tmp_path / "wifi.csv"
    file.write_text("t_s,bssid,rssi_dbm,frequency_mhz,age_s\n1,aa,-50,2437,\n")
    wifi = read_wifi(file)
    assert wifi.rssi_dbm.tolist() == [[-50]]
    assert np.isnan(wifi.age_s).all()


HEADER = "t_s,bssid,rssi_dbm,frequency_mhz,age_s\n"
DAMAGES = {
    "t_s,bssid,frequency_mhz,age_s\n1,aa,2437,0\n": "column rssi_dbm is missing",
    HEADER + "1,aa,-50,2437\n": "row 2 has 4 cells, wanted 5",
    HEADER + "1,aa,loud,2437,0\n": "row 2 has 'loud'",
    HEADER + "1,aa,nan,2437,0\n": "row 2 has 'nan'",
    HEADER + "2,aa,-50,2437,0\n1,aa,-50,2437,0\n": "runs backward at row 3",
    HEADER + '1,"aa,-50,2437,0\n': "cannot be read as CSV",
    HEADER + ",,,,\n": "row 2 has ''",
    HEADER: "no rows",
    "": "is empty",
}


@pytest.mark.parametrize("text", DAMAGES)
def test_damaged_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "wifi.csv").write_text(text)
    with pytest.raises(InputError, match=DAMAGES[text]):
        read_wifi(tmp_path / "wifi.csv")


SCANS = st.dictionaries(
    st.tuples(
        st.integers(0, 9),
        st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\r")),
    ),
    st.tuples(st.integers(-100, 0), st.one_of(st.just(np.nan), st.integers(0, 99))),
    min_size=1,
)


@given(SCANS)
def test_any_name_round_trips(
    tmp_path_factory: pytest.TempPathFactory, seen: dict[tuple[int, str], tuple[int, float]]
) -> None:
    t_s, bssids = zip(*seen, strict=True)
    wifi = scans_from_rows(FILE, t_s, bssids, *zip(*seen.values(), strict=True))
    file = tmp_path_factory.getbasetemp() / "wifi.csv"
    write_wifi(wifi, file)
    read = read_wifi(file)
    assert read.bssids == wifi.bssids
    for name in ("t_s", "rssi_dbm", "age_s"):
        np.testing.assert_array_equal(getattr(read, name), getattr(wifi, name))


def test_a_name_that_would_not_be_read_back_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="carriage return"):
        write_wifi(scans_from_rows(FILE, [1.0], ["a\rb"], [-50], [0]), tmp_path / "wifi.csv")
    assert list(tmp_path.iterdir()) == []


def test_a_table_that_is_almost_all_empty_is_refused() -> None:
    """A time and a name of its own for each row: 10 MB of rows would be 160 GB of table."""
    count = 4_000
    rows = [float(k) for k in range(count)], [str(k) for k in range(count)]
    with pytest.raises(InputError, match=r"wifi\.csv: 4000 scans of 4000 access points"):
        scans_from_rows(FILE, *rows, [-50.0] * count, [0.0] * count)


@pytest.mark.parametrize("line", ["1\n", ",\n", "0,a,-50,,0\n"])
def test_a_large_file_takes_a_few_times_its_own_size(tmp_path: Path, line: str) -> None:
    text = "t_s,bssid,rssi_dbm,frequency_mhz,age_s\n" + line * (500_000 // len(line))
    (tmp_path / "wifi.csv").write_text(text)
    tracemalloc.start()
    try:
        with suppress(InputError):
            read_wifi(tmp_path / "wifi.csv")
        assert tracemalloc.get_traced_memory()[1] < 15 * len(text)
    finally:
        tracemalloc.stop()
