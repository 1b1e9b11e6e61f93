"""Maps in tiles: what is cut is what is put together, and a change stays where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import FloorMap, Payload
from elfslam.data.tiles import encoder_identity, map_of_tiles, phone_of, tiles_of
from elfslam.line.feature import MEAN_LOG_SPECTRUM, PHONE

PLACES = np.array([[7.9, -0.1], [0.0, 0.0], [8.0, 0.0], [-3.0, 7.0], [7.0, 7.9], [0.5, 0.0]])
ORDER = [3, 0, 1, 4, 5, 2]
"""The spots by the squares (-1, 0), (0, -1), (0, 0) and (1, 0)."""


def a_map(phone: np.ndarray | None = None) -> FloorMap:
    generator = np.random.default_rng(3)
    count = len(PLACES)
    root = generator.normal(size=(count, 2, 2))
    payloads = [Payload("elf", "abc", generator.normal(0, 0.09, (count, 128)).astype(np.float32))]
    if phone is not None:
        payloads.append(Payload(PHONE, MEAN_LOG_SPECTRUM, np.tile(phone, (count, 1))))
    return FloorMap(
        xy_m=PLACES,
        heading_rad=generator.uniform(-3, 3, count),
        walk=np.zeros(count, dtype=np.int64),
        order=np.arange(count),
        covariance_m2=root @ root.transpose(0, 2, 1),
        payloads=tuple(payloads),
        parameters_digest="d",
        sources=("walk",),
        weight=generator.uniform(0.1, 1, count),
    )


def test_what_is_cut_is_put_together() -> None:
    phone = np.linspace(-1, 1, 12, dtype=np.float32)
    given = a_map(phone)
    tiles = tiles_of(given)
    assert [(tile.square, tile.spots) for tile in tiles] == [
        ((-1, 0), 1), ((0, -1), 1), ((0, 0), 3), ((1, 0), 1)
    ]  # fmt: skip
    read = map_of_tiles(
        [tile.content for tile in tiles],
        encoder=encoder_identity(given),
        phone=phone_of(given),
        source="walk",
    )
    for name in ("xy_m", "heading_rad", "covariance_m2", "weight"):
        wanted = getattr(given, name)[ORDER].astype(np.float32)
        npt.assert_array_equal(getattr(read, name), wanted)
    for payload, wanted in zip(read.payloads, given.payloads, strict=True):
        assert (payload.kind, payload.encoder) == (wanted.kind, wanted.encoder)
    halves = given.payloads[0].vectors[ORDER].astype(np.float16)
    npt.assert_array_equal(read.payloads[0].vectors, halves.astype(np.float32))
    npt.assert_array_equal(read.payloads[1].vectors, np.tile(phone, (6, 1)))
    assert phone_of(a_map()) is None


def test_a_change_stays_in_its_tile() -> None:
    given = a_map()
    weight = given.weight.copy()
    weight[2] /= 2
    before, after = tiles_of(given), tiles_of(replace(given, weight=weight))
    assert [a.content == b.content for a, b in zip(before, after, strict=True)] == [
        True, True, True, False
    ]  # fmt: skip


@pytest.mark.parametrize("kept", [0, 3, 100, -1])
def test_a_tile_that_is_cut_off_is_refused(kept: int) -> None:
    content = tiles_of(a_map())[0].content[:kept]
    with pytest.raises(InputError, match="fetch it again"):
        map_of_tiles([content], encoder="abc", phone=None, source="walk")


def test_a_map_without_learnt_features_is_refused() -> None:
    given = a_map()
    other = Payload("elf", "spectral-1", np.zeros((len(PLACES), 576), dtype=np.float32))
    for payloads in ((), (other,)):
        with pytest.raises(InputError, match="by its echoes"):
            tiles_of(replace(given, payloads=payloads))
