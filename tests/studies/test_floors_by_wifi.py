"""The city that benchmarks ask about: what is heard where, and that it is the same again."""

import numpy as np
import numpy.testing as npt

from studies.floors_by_wifi import (
    CityParameters,
    Hearing,
    block_of,
    heard_now,
    mean_levels_dbm,
    scans_in,
)

PARAMETERS = CityParameters()
STILL = CityParameters(shadowing_db=0.0, fading_db=0.0, missed_share=0.0, hotspots=0.0)


def test_a_block_is_the_same_again_and_no_other() -> None:
    one, same, other = (
        block_of(1, 2, PARAMETERS),
        block_of(1, 2, PARAMETERS),
        block_of(1, 3, PARAMETERS),
    )
    npt.assert_array_equal(one.address, same.address)
    assert not set(one.address[one.address > 0]) & set(other.address[other.address > 0])
    generator = np.random.default_rng(0)
    assert len(scans_in(one, 0, 1, 5, generator, PARAMETERS).t_s) == 5


def test_levels_fall_with_distance_slabs_and_facades() -> None:
    block = block_of(1, 0, STILL)
    radio = int(np.argmax(block.house == 1))
    floor = int(block.position_m[radio, 2] // STILL.storey_m)
    near = block.position_m[radio] + [[2.0, 0, 0], [20.0, 0, 0]]
    levels = mean_levels_dbm(block, 1, floor, near, STILL)[:, radio]
    assert np.isclose(levels[0] - levels[1], 10 * block.exponent[1])
    above = mean_levels_dbm(block, 1, floor + 2, near, STILL)[:, radio]
    npt.assert_allclose(levels - above, STILL.slab_db + STILL.more_slabs_db)
    outside = mean_levels_dbm(block, 0, floor, near, STILL)[:, radio]
    between = 10 * (block.exponent[0] - block.exponent[1]) * np.log10([2.0, 20.0])
    npt.assert_allclose(levels - outside, 2 * STILL.facade_db + between)


def test_phones_hear_differently_and_radios_are_replaced() -> None:
    block = block_of(1, 0, STILL)

    def heard(hearing: Hearing) -> dict[str, float]:
        return heard_now(scans_in(block, 0, 0, 1, np.random.default_rng(4), STILL, hearing), [0])

    plain, deaf, aged = heard(Hearing()), heard(Hearing(deaf_db=7)), heard(Hearing(0, 0.5))
    assert all(abs(plain[name] - level - 7) <= 1 for name, level in deaf.items())
    assert len(deaf) < len(plain)
    assert 0.2 < len(aged.keys() & plain.keys()) / len(plain) < 0.8
    assert abs(len(aged) - len(plain)) <= 3
