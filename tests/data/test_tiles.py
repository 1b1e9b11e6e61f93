"""Maps in tiles: what is cut is what is put together, and a change stays where it is."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import FloorMap, Payload
from elfslam.data.tiles import encoder_identity, stretches_of, tiles_of
from tests.data.phone_maps import map_of_parts

PLACES = np.array([[7.9, -0.1], [0.0, 0.0], [8.0, 0.0], [-3.0, 7.0], [7.0, 7.9], [0.5, 0.0]])
ORDER = [3, 0, 1, 4, 5, 2]
"""The spots by the squares (-1, 0), (0, -1), (0, 0) and (1, 0)."""


def a_map() -> FloorMap:
    generator = np.random.default_rng(3)
    count = len(PLACES)
    root = generator.normal(size=(count, 2, 2))
    elfs = Payload("elf", "abc", generator.normal(0, 0.09, (count, 128)).astype(np.float32))
    return FloorMap(
        xy_m=PLACES,
        heading_rad=generator.uniform(-3, 3, count),
        walk=np.array([0, 0, 0, 0, 0, 2]),
        order=np.array([5, 0, 300, 256, 255, 5]),
        covariance_m2=root @ root.transpose(0, 2, 1),
        payloads=(elfs,),
        parameters_digest="d",
        sources=("one", "two", "three"),
        weight=generator.uniform(0.1, 1, count),
    )


def test_what_is_cut_is_put_together() -> None:
    given = a_map()
    tiles, stretches = tiles_of(given), stretches_of(given)
    assert [(tile.square, tile.spots) for tile in tiles] == [
        ((-1, 0), 1), ((0, -1), 1), ((0, 0), 3), ((1, 0), 1)
    ]  # fmt: skip
    assert [(each.walk, each.spots) for each in stretches] == [(0, 3), (0, 2), (2, 1)]
    read = map_of_parts(
        [tile.content for tile in tiles],
        [(each.walk, each.content) for each in stretches],
        encoder=encoder_identity(given),
        sources=given.sources,
    )
    for name in ("walk", "order"):
        npt.assert_array_equal(getattr(read, name), getattr(given, name)[ORDER])
    for name in ("xy_m", "heading_rad", "covariance_m2", "weight"):
        wanted = getattr(given, name)[ORDER].astype(np.float32)
        npt.assert_array_equal(getattr(read, name), wanted)
    for payload, wanted in zip(read.payloads, given.payloads, strict=True):
        assert (payload.kind, payload.encoder) == (wanted.kind, wanted.encoder)
    halves = given.payloads[0].vectors[ORDER].astype(np.float16)
    npt.assert_array_equal(read.payloads[0].vectors, halves.astype(np.float32))


def test_a_change_stays_in_its_tile() -> None:
    given = a_map()
    weight = given.weight.copy()
    weight[2] /= 2
    faded = replace(given, weight=weight)
    before, after = tiles_of(given), tiles_of(faded)
    assert stretches_of(faded) == stretches_of(given)
    assert [a.content == b.content for a, b in zip(before, after, strict=True)] == [
        True, True, True, False
    ]  # fmt: skip


def test_spots_that_their_order_does_not_tell_apart_keep_their_features() -> None:
    given = replace(a_map(), walk=np.zeros(6, dtype=np.int64), order=np.zeros(6, dtype=np.int64))
    tiles = [tile.content for tile in tiles_of(given)]
    stretches = [(each.walk, each.content) for each in stretches_of(given)]
    read = map_of_parts(tiles, stretches, encoder="abc", sources=("one",))
    halves = given.payloads[0].vectors[ORDER].astype(np.float16)
    npt.assert_array_equal(read.payloads[0].vectors, halves.astype(np.float32))


def test_a_map_without_learnt_features_is_refused() -> None:
    given = a_map()
    other = Payload("elf", "spectral-1", np.zeros((len(PLACES), 576), dtype=np.float32))
    for payloads in ((), (other,)):
        with pytest.raises(InputError, match="by its echoes"):
            stretches_of(replace(given, payloads=payloads))
