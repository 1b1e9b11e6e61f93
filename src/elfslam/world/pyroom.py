"""A second engine for echoes: the image sources of pyroomacoustics, where it can model the scene.

pyroomacoustics (Scheibler, Bezzam and Dokmanic, ICASSP 2018) knows walls, floor, ceiling and closed
solids between them. It is slow, and here to check `phone.image_echoes`. It comes with the extra
`acoustics`.
"""

from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.extras import installing
from elfslam.base.grid import in_ring
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers
from elfslam.world.pulses import C64, Air
from elfslam.world.scene import Scene

RATE_HZ = 100_000
"""High enough that the fractional delays of pyroomacoustics are good to 0.1 % within the band."""
MOST_IMAGES = 3e6
TOUCH_M = 1e-6


def image_echoes(scene: Scene, ends: Transducers, people_m: F64, air: Air, reach: Reach) -> C64:
    """Envelopes (n, 630) as `phone.image_echoes` gives them, by pyroomacoustics.

    It knows no holder: held phones lack their direct sound, but nobody's body shadows them. Raises
    InputError where pyroomacoustics is not installed or cannot model what is asked for.
    """
    _refuse(scene, ends, people_m, reach)
    library = _library()
    return np.stack(
        [_envelope(library, scene, ends, row, air, reach) for row in range(len(ends.speaker))]
    )


def visible_images(scene: Scene, ends: Transducers, row: int, reach: Reach) -> tuple[F64, F64, I64]:
    """Length in metres, reflection gain and order (k each) of every path that one phone hears.

    In single precision, as pyroomacoustics has them. Raises as `image_echoes`.
    """
    _refuse(scene, ends, np.zeros((0, 0, 2)), reach)
    room = _room(_library(), scene, ends, row, reach)
    source = _images(room, scene, ends, row, reach)
    if source is None:
        return np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64)
    heard = room.visibility[0][0].astype(bool)
    length_m = _lengths_m(room)[heard]
    gain = np.asarray(source.damping[0][heard], dtype=np.float64)
    return length_m, gain, np.asarray(source.orders[heard], dtype=np.int64)


def _library() -> ModuleType:
    try:
        import pyroomacoustics
    except ImportError as cause:
        raise InputError(
            "the second engine needs pyroomacoustics, which is not installed; "
            f"{installing('acoustics')}"
        ) from cause
    return pyroomacoustics  # type: ignore[no-any-return]


def _refuse(scene: Scene, ends: Transducers, people_m: F64, reach: Reach) -> None:
    low = scene.block_low > TOUCH_M
    unknown = {
        "blocks that do not reach from floor to ceiling": low.any()
        or (scene.block_high < scene.height - TOUCH_M).any(),
        "clutter and scattering surfaces": len(scene.point_radius),
        "edges that diffract": len(scene.edge_a),
        "people": people_m.shape[1],
        "lobes": ends.speaker_lobe_share or ends.microphone_lobe_share,
        "moving phones": ends.microphone_velocity.any() or ends.speaker_velocity.any(),
    }
    found = [name for name, is_there in unknown.items() if is_there]
    if found:
        raise InputError(
            f"pyroomacoustics models no {', '.join(found)}; take quiet walks or another engine",
            argument="kind",
        )
    outline_m = scene.face_a[: scene.outer]
    if not all(in_ring(outline_m, end[:, :2]).all() for end in (ends.speaker, ends.microphone)):
        raise InputError("pyroomacoustics hears nothing outside a room; move the phones inside")
    if _is_box(scene):
        return
    kinds = [reach.plan_order]
    if len(scene.block_low):
        kinds += [reach.block_order, reach.beside_block]
    if min(kinds) < reach.order:
        raise InputError(
            f"pyroomacoustics limits reflections by their number alone, got {reach}; raise "
            "plan_order, block_order and beside_block to the order"
        )
    images = float(len(scene.face_a) + 1) ** reach.order
    if images > MOST_IMAGES:
        raise InputError(
            f"order {reach.order} among {len(scene.face_a) + 2} faces makes {images:.1e} images, "
            f"wanted at most {MOST_IMAGES:.1e}; lower the order"
        )


def _is_box(scene: Scene) -> bool:
    """Whether the room is an empty rectangle along the axes, for which there is a faster way."""
    along = np.abs(scene.face_b - scene.face_a)
    return len(along) == scene.outer == 4 and bool((along.min(axis=1) == 0.0).all())


def _room(library: Any, scene: Scene, ends: Transducers, row: int, reach: Reach) -> Any:
    room = _box(library, scene, reach) if _is_box(scene) else _solids(library, scene, reach)
    origin = _origin(scene)
    lobes = (
        library.directivities.CardioidFamily(axis[row], p=1.0 - directivity)
        if directivity
        else None
        for axis, directivity in (
            (ends.speaker_axis, ends.speaker_directivity),
            (ends.microphone_axis, ends.microphone_directivity),
        )
    )
    # Its own test casts rays at random and now and then finds a point inside to be outside.
    room.is_inside = lambda point: True
    room.add_source(ends.speaker[row] - origin, directivity=next(lobes))
    room.add_microphone(ends.microphone[row] - origin, directivity=next(lobes))
    return room


def _origin(scene: Scene) -> F64:
    """A lower corner (3): single precision is best used near zero."""
    return np.append(scene.face_a[: scene.outer].min(axis=0), 0.0)


def _box(library: Any, scene: Scene, reach: Reach) -> Any:
    size = np.append(np.ptp(scene.face_a, axis=0), scene.height)
    gains = {"floor": scene.floor_gain, "ceiling": scene.ceiling_gain}
    names = {(1, 0): "west", (-1, 0): "east", (0, 1): "south", (0, -1): "north"}
    for normal, gain in zip(np.round(scene.face_normal).astype(int), scene.face_gain, strict=True):
        gains[names[normal[0], normal[1]]] = gain
    materials = {name: library.Material(1.0 - gain**2) for name, gain in gains.items()}
    return library.ShoeBox(size, fs=RATE_HZ, materials=materials, max_order=reach.order)


def _solids(library: Any, scene: Scene, reach: Reach) -> Any:
    """A room of walls whose normals point out of the air, into walls and blocks."""
    origin = _origin(scene)[:2]
    a, b = scene.face_a - origin, scene.face_b - origin
    a[scene.outer :], b[scene.outer :] = b[scene.outer :].copy(), a[scene.outer :].copy()
    shapes = [
        np.array([[*p, 0.0], [*q, 0.0], [*q, scene.height], [*p, scene.height]])
        for p, q in zip(a, b, strict=True)
    ]
    outline = scene.face_a[: scene.outer] - origin
    shapes.append(np.column_stack([outline[::-1], np.zeros(scene.outer)]))
    shapes.append(np.column_stack([outline, np.full(scene.outer, scene.height)]))
    gains = np.append(scene.face_gain, [scene.floor_gain, scene.ceiling_gain])
    walls = [
        library.wall_factory(shape.T.astype(np.float32), [1.0 - gain**2], [0.0], f"{k}")
        for k, (shape, gain) in enumerate(zip(shapes, gains, strict=True))
    ]
    return library.Room(walls, fs=RATE_HZ, max_order=reach.order)


def _images(room: Any, scene: Scene, ends: Transducers, row: int, reach: Reach) -> Any:
    """The source with its images, of which only those that count stay visible; None without any."""
    room.image_source_model()
    source = room.sources[0]
    if source.images is None or np.shape(room.visibility[0]) != (1, source.images.shape[1]):
        return None
    keep = _lengths_m(room) <= reach.longest_m
    keep &= (source.orders > 0) | (not ends.held)
    if _is_box(scene):
        keep &= np.abs(source.orders_xyz[:2]).sum(axis=0) <= reach.plan_order
    room.visibility[0] &= keep[None]
    return source if room.visibility[0].any() else None


def _lengths_m(room: Any) -> F64:
    images = np.asarray(room.sources[0].images, dtype=np.float64)
    return np.asarray(np.linalg.norm(images - room.mic_array.R[:, :1], axis=0))


def _envelope(
    library: Any, scene: Scene, ends: Transducers, row: int, air: Air, reach: Reach
) -> npt.NDArray[np.complex64]:
    room = _room(library, scene, ends, row, reach)
    room.set_sound_speed(air.speed_mps)
    source = _images(room, scene, ends, row, reach)
    if source is None:
        return np.zeros(BAND_BINS, dtype=np.complex64)
    source.damping = source.damping * np.exp(-air.attenuation_per_m * _lengths_m(room))
    room.compute_rir()
    late = library.constants.get("frac_delay_length") // 2
    size = round(RATE_HZ / BIN_HZ)
    heard: F64 = np.asarray(room.rir[0][0], dtype=np.float64)[: size + late]
    hz = BAND_LOW_HZ + BIN_HZ * np.arange(BAND_BINS)
    first = round(BAND_LOW_HZ / BIN_HZ)
    folded = np.zeros(size)
    np.add.at(folded, np.arange(len(heard)) % size, heard)
    spectrum = np.fft.rfft(folded)[first : first + BAND_BINS]
    spectrum *= np.exp(2j * np.pi * hz * late / RATE_HZ)
    return np.fft.ifft(np.fft.ifftshift(spectrum)).astype(np.complex64)
