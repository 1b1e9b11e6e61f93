"""The second engine: the same sound where it can model the scene, one line where it cannot."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.world import phone, pyroom
from elfslam.world.materials import Material, material
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers, air_at
from elfslam.world.room import Block, Room, box, shoebox
from elfslam.world.scene import Scene, scene_of
from studies.fidelity import correlation_of

NOBODY = np.zeros((1, 0, 2))
REACH = Reach(longest_m=21.0, order=3, plan_order=3, block_order=3, beside_block=3)
ELL_M = np.array([[0, 0], [6, 0], [6, 3], [3, 3], [3, 5], [0, 5]], dtype=float)
PLAIN = Material("plain", 0.3, 0.0, "planted")
PILLAR = box("pillar", [4.1, 5.0, 0.0], [0.5, 0.4, 2.5], PLAIN, 0.3, 0.0)


def walls(count: int) -> tuple[Material, ...]:
    return tuple(Material(f"{k}", 0.1 + 0.08 * k, 0.0, "planted") for k in range(count))


def ell(*blocks: Block) -> Scene:
    return scene_of(Room(ELL_M + 3.0, 2.5, walls(6), *walls(2), blocks))


def rectangle() -> Scene:
    return scene_of(shoebox(np.array([6.0, 5.0, 2.5]), walls(6)))


def ends_at(directivity: float = 0.0, *, held: bool = False, shift_m: float = 0.0) -> Transducers:
    axis = np.array([[2.0, -1.0, 0.5]]) / np.linalg.norm([2.0, -1.0, 0.5])
    # Nowhere on a diagonal: paths into a corner belong to both walls or to neither.
    speaker, microphone = np.array([[1.03, 1.21, 1.2]]), np.array([[2.07, 3.94, 1.5]])
    shift = np.array([shift_m, shift_m, 0.0])
    return Transducers(
        speaker + shift, microphone + shift, axis, axis[:, [1, 0, 2]], np.zeros((1, 2)),
        np.zeros((1, 3)), np.zeros((1, 3)), directivity, directivity / 2, held,
    )  # fmt: skip


def both(scene: Scene, ends: Transducers, reach: Reach = REACH) -> tuple[phone.C64, phone.C64]:
    rest = (scene, ends, NOBODY, air_at(), reach)
    return phone.image_echoes(*rest), pyroom.image_echoes(*rest)


def level_of(responses: phone.C64) -> float:
    """Within 16 to 19 kHz: towards the ends of the band our pulses fade."""
    spectrum = np.fft.fftshift(np.fft.fft(responses, axis=1), axes=1)
    return float(np.linalg.norm(spectrum[:, 165:465]))


@pytest.mark.parametrize("directivity", [0.0, 0.5])
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("which", ["rectangle", "ell", "ell with a pillar"])
def test_both_engines_hear_the_same(which: str, directivity: float, held: bool) -> None:
    scene = {"rectangle": rectangle(), "ell": ell()}.get(which, ell(PILLAR))
    ends = ends_at(directivity, held=held, shift_m=0.0 if which == "rectangle" else 3.0)
    ours, theirs = both(scene, ends)
    assert ours.shape == theirs.shape == (1, 630)
    assert ours.dtype == theirs.dtype == np.complex64
    assert correlation_of(ours, theirs) > 0.999
    assert level_of(ours) == pytest.approx(level_of(theirs), rel=0.02)


def test_a_change_to_one_wall_is_heard_as_a_difference() -> None:
    """The comparison can fail: one wall that absorbs all is enough."""
    dead = (*walls(5), replace(PLAIN, absorption=1.0))
    ours, _ = both(scene_of(shoebox(np.array([6.0, 5.0, 2.5]), dead)), ends_at())
    _, theirs = both(rectangle(), ends_at())
    assert correlation_of(ours, theirs) < 0.99


def test_lengths_and_gains_of_its_paths() -> None:
    length_m, gain, order = pyroom.visible_images(rectangle(), ends_at(), 0, REACH)
    direct = np.linalg.norm([1.04, 2.73, 0.3])
    assert length_m[order == 0] == pytest.approx([direct])
    assert gain[order == 0] == pytest.approx([1.0])
    assert sorted(gain[order == 1]) == pytest.approx(sorted(wall.reflection for wall in walls(6)))
    held = pyroom.visible_images(rectangle(), ends_at(held=True), 0, REACH)
    assert len(held[0]) == len(length_m) - 1


def test_a_closed_partition_leaves_silence() -> None:
    """Nothing at all is heard across it, not even round a corner."""
    across = box("partition", [-0.5, 2.0, 0.0], [7.0, 0.2, 2.5], PLAIN, 0.0, 0.0)
    scene = scene_of(shoebox(np.array([6.0, 5.0, 2.5]), walls(6), (across,)))
    ours, theirs = both(scene, ends_at())
    assert not ours.any()
    assert not theirs.any()


TABLE = box("table", [4.0, 4.5, 0.0], [1.5, 0.8, 0.7], PLAIN, 0.0, 0.0)
LAMP = box("lamp", [4.0, 4.5, 1.8], [1.5, 0.8, 0.7], PLAIN, 0.0, 0.0)


@pytest.mark.parametrize(
    ("scene", "people_m", "complaint"),
    [
        (ell(TABLE), NOBODY, "no blocks that do not reach from floor to ceiling, edges"),
        (ell(LAMP), NOBODY, "no blocks that do not reach from floor to ceiling, edges"),
        (ell(replace(PILLAR, clutter_per_m2=9.0)), NOBODY, "no clutter and scattering surf"),
        (ell(), np.ones((1, 1, 2)), "no people; take quiet walks or another engine"),
    ],
)
def test_what_it_cannot_model_is_refused(scene: Scene, people_m: F64, complaint: str) -> None:
    with pytest.raises(InputError, match=f"pyroomacoustics models {complaint}"):
        pyroom.image_echoes(scene, ends_at(shift_m=3.0), people_m, air_at(), REACH)


def test_rough_walls_moving_phones_and_places_outside_are_refused() -> None:
    rough = scene_of(shoebox(np.array([6.0, 5.0, 2.5]), (material("brick"),) * 6))
    with pytest.raises(InputError, match="no clutter and scattering surfaces; take quiet walks"):
        pyroom.image_echoes(rough, ends_at(), NOBODY, air_at(), REACH)
    moving = ends_at()._replace(microphone_velocity=np.array([[1.0, 0.0, 0.0]]))
    with pytest.raises(InputError, match="no moving phones; take quiet walks"):
        pyroom.image_echoes(rectangle(), moving, NOBODY, air_at(), REACH)
    lobed = ends_at()._replace(microphone_lobe_share=0.2)
    with pytest.raises(InputError, match="no lobes; take quiet walks"):
        pyroom.image_echoes(rectangle(), lobed, NOBODY, air_at(), REACH)
    with pytest.raises(InputError, match="hears nothing outside a room; move the phones"):
        pyroom.image_echoes(ell(), ends_at(), NOBODY, air_at(), REACH)


@pytest.mark.parametrize(
    ("reach", "complaint"),
    [
        (REACH._replace(plan_order=2), "limits reflections by their number alone"),
        (REACH._replace(beside_block=2), "raise plan_order, block_order and beside_block"),
        (Reach(21.0, 9, 9, 9, 9), "order 9 among 12 faces makes .* images, wanted at most"),
    ],
)
def test_a_reach_it_cannot_follow_is_refused(reach: Reach, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        pyroom.image_echoes(ell(PILLAR), ends_at(shift_m=3.0), NOBODY, air_at(), reach)


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyroomacoustics", None)
    with pytest.raises(InputError, match=r"run make studies"):
        pyroom.image_echoes(rectangle(), ends_at(), NOBODY, air_at(), REACH)
