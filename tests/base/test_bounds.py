"""What a file may claim grows with it, and ends."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base.bounds import FREE_BYTES, MOST_BYTES, RATIO, check_claim, most_bytes
from elfslam.base.errors import InputError

SIZES = st.integers(0, 2**40)


@given(SIZES, SIZES)
def test_more_bytes_may_claim_more_up_to_an_end(one: int, other: int) -> None:
    small, large = sorted((one, other))
    assert FREE_BYTES <= most_bytes(small) <= most_bytes(large) <= MOST_BYTES


@given(SIZES)
def test_the_most_may_be_claimed_and_no_byte_more(size: int) -> None:
    check_claim("walk", "its header", most_bytes(size), size)
    with pytest.raises(InputError, match="walk: its header claims"):
        check_claim("walk", "its header", most_bytes(size) + 1, size)


@pytest.mark.parametrize("claimed", [10.0**12, math.inf, math.nan, 10**30])
def test_what_no_machine_holds_is_refused(claimed: float) -> None:
    with pytest.raises(InputError, match="cut it in parts"):
        check_claim("walk", "its header", claimed, 10**9)


def test_a_file_may_hold_a_hundredfold() -> None:
    check_claim("walk", "it", FREE_BYTES + RATIO * 1000, 1000)
