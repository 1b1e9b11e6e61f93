"""Diffuse reflection: the chains of scatterings between the patches of a room (acoustic radiosity).

Each patch scatters by Lambert's cosine law (Nosal, Hodgson and Ashdown, J. Acoust. Soc. Am. 116,
2004). Chains of two and more scatterings are drawn once, by tracing particles from every patch;
kept of them are the first and the last patch, the length between the two and the gain. A phone only
adds its ways to the first and from the last patch. A chain keeps its sign for ever and leads both
ways: echoes are coherent, repeatable and reciprocal.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.world.kernels import kernel
from elfslam.world.materials import Material, scattering_rise
from elfslam.world.patches import (
    Faces,
    Patches,
    boxes_of,
    draws_by_owner,
    faces_and_patches,
    first_face,
    patch_at,
)
from elfslam.world.pulses import I32
from elfslam.world.room import Room

FITTINGS: Mapping[str, float] = MappingProxyType(
    dict.fromkeys(
        ("glass", "tile", "metal", "concrete", "brick", "metal shutter", "acoustic ceiling tile"),
        0.45,
    )
)
"""Share that scatters at what stands and hangs on a surface: the frames, goods, joints and lamps of
halls; `OTHER_FITTINGS` elsewhere."""
OTHER_FITTINGS = 0.21
ABSORPTION = (0.08, 0.5)
"""Of surfaces at 15 to 20 kHz, at least and at most. These and the fittings are chosen in the
development worlds, so that rooms are as measured ones in kurtosis, spread and reverberation time of
their responses, and in how fast echoes change with the place (`python -m studies realism`)."""
LONGEST_M = 21.0
PARTICLES = 2400
"""From all patches that one phone hears together; more make a smoother field and take longer."""
PARTICLES_A_PATCH = (6, 12)
MOST_SCATTERINGS = 16
MOST_REFLECTIONS = 20
LEAST_SCATTERED = 0.05
DRAWS = 4
"""For each reflection: two for the direction, one for its fate and one for the chain's sign."""


class Chains(NamedTuple):
    """Chains of patch p are `start[p]` to `start[p + 1]`, by growing `length`; they end at `to`.

    `gain` is the pressure 1 m before the last patch per pressure at the first, cosines apart, and
    `fall` the power of the frequency with which it falls about 17.5 kHz.
    """

    start: I64
    to: I32
    length: F64
    gain: F64
    fall: F64


class Scattering(NamedTuple):
    """What a room scatters; `once` (p) is the signed gain of a patch alone, as of a chain."""

    patches: Patches
    once: F64
    chains: Chains


def as_measured(room: Room) -> Room:
    """The room with surfaces that scatter and absorb as those of measured rooms do.

    What absorbs all is no surface but an opening, and stays one.
    """

    def rougher(surface: Material) -> Material:
        if surface.absorption == 1:
            return surface
        fittings = FITTINGS.get(surface.name, OTHER_FITTINGS)
        return replace(
            surface,
            scattering=1 - (1 - surface.scattering) * (1 - fittings),
            absorption=float(np.clip(surface.absorption, *ABSORPTION)),
        )

    return replace(
        room,
        walls=tuple(rougher(wall) for wall in room.walls),
        floor=rougher(room.floor),
        ceiling=rougher(room.ceiling),
        blocks=tuple(replace(block, surface=rougher(block.surface)) for block in room.blocks),
    )


def scattering_of(room: Room) -> Scattering:
    """Patches and chains of a room: the same for the same room and its seed."""
    faces, patches = faces_and_patches(room)
    once = np.sqrt(patches.area * faces.kept[patches.face] * patches.scattered / np.pi)
    particles = _particles(room, len(once))
    noted = _trace(room, faces, patches, particles)
    chains = _both_ways(noted, patches, _scattered(faces, patches))
    signs = draws_by_owner(room, 2, faces.cells.prod(axis=1), ())[patches.cell]
    signed = np.where(signs < 0.5, -once, once)
    return Scattering(patches, signed, chains)


def _scattered(faces: Faces, patches: Patches) -> tuple[float, float]:
    """The room's mean share of scattering, and the power of the frequency with which it grows."""
    share = float(np.average(faces.scattered[patches.face], weights=patches.area))
    weights = patches.area * np.maximum(patches.scattered, LEAST_SCATTERED)
    grows = 2 * float(np.average(scattering_rise(patches.scattered), weights=weights))
    return max(share, LEAST_SCATTERED), grows


def _particles(room: Room, patches: int) -> int:
    """How many particles leave each patch: so many that a phone always hears about as many."""
    heard = min(np.pi * (LONGEST_M / 2) ** 2 / float(np.prod(room.size_m[:2])), 1.0) * patches
    return int(np.clip(PARTICLES / heard, *PARTICLES_A_PATCH))


def _both_ways(noted: F64, patches: Patches, scattered: tuple[float, float]) -> Chains:
    """Chains from noted rows of first patch, last patch, length, signed energy and fall, and their
    reversals.

    The mirrored share of the ways from and to the phone is not followed to where it is scattered:
    it is added here, by the mean share that surfaces scatter and how that grows, at both ends.
    """
    share, grows = scattered
    gain = np.sign(noted[:, 3]) * np.sqrt(np.abs(noted[:, 3]) / 2) / share
    begin = np.concatenate([noted[:, 0], noted[:, 1]]).astype(np.int64)
    end = np.concatenate([noted[:, 1], noted[:, 0]]).astype(np.int32)
    length, gain, fall = (np.tile(rows, 2) for rows in (noted[:, 2], gain, noted[:, 4] + grows))
    order = np.lexsort((length, begin))
    start = np.searchsorted(begin[order], np.arange(len(patches.area) + 1)).astype(np.int64)
    return Chains(start, end[order], length[order], gain[order], fall[order])


def _trace(room: Room, faces: Faces, patches: Patches, particles: int) -> F64:
    """Rows of first patch, last patch, length (m), signed energy and fall of every chain."""
    boxes, walls = boxes_of(room), len(room.walls)
    draws = draws_by_owner(room, 3, faces.cells.prod(axis=1), (particles, MOST_REFLECTIONS, DRAWS))[
        patches.cell
    ]
    noted = np.zeros((len(patches.area) * particles * MOST_SCATTERINGS, 5))
    return noted[: _trace_particles(noted, faces, patches, boxes, walls, draws)]


@kernel
def _lambert(faces, f, square, turn):
    """A direction away from face f by Lambert's law, from two numbers between 0 and 1."""
    radius, angle = np.sqrt(square), 2.0 * np.pi * turn
    a, b, c = radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - square)
    u, v, n = faces.along[f], faces.up[f], faces.normal[f]
    return (
        a * u[0] + b * v[0] + c * n[0],
        a * u[1] + b * v[1] + c * n[1],
        a * u[2] + b * v[2] + c * n[2],
    )


@kernel
def _trace_particle(noted, count, faces, patches, boxes, walls, first, energy, draws):
    """Follows one particle from patch `first`; notes a chain where it is scattered; their count."""
    f, here, length, leg, order = patches.face[first], first, 0.0, 0.0, 1
    fall = patches.diffuse_fall[first]
    point = patches.point[here]
    x, y, z = point[0], point[1], point[2]
    dx, dy, dz = _lambert(faces, f, draws[0, 0], draws[0, 1])
    for k in range(1, draws.shape[0]):
        n = faces.normal[f]
        f, way = first_face(
            faces, boxes, walls, x + 1e-6 * n[0], y + 1e-6 * n[1], z + 1e-6 * n[2], dx, dy, dz
        )
        if f < 0 or length + leg + way > LONGEST_M or order == MOST_SCATTERINGS:
            break
        x, y, z, leg = x + way * dx, y + way * dy, z + way * dz, leg + way
        energy *= faces.kept[f]
        here = patch_at(faces, f, x, y, z)
        share = patches.scattered[here] if here >= 0 else faces.scattered[f]
        if draws[k, 2] >= share:
            n = faces.normal[f]
            into = 2.0 * (dx * n[0] + dy * n[1] + dz * n[2])
            dx, dy, dz = dx - into * n[0], dy - into * n[1], dz - into * n[2]
            fall += patches.mirror_fall[here] if here >= 0 else faces.mirror_fall[f]
            continue
        if here < 0:
            break
        length, leg, order, fall = length + leg, 0.0, order + 1, fall + patches.diffuse_fall[here]
        noted[count, 0], noted[count, 1] = first, here
        noted[count, 2], noted[count, 3] = length, energy if draws[k, 3] < 0.5 else -energy
        noted[count, 4] = fall
        count += 1
        point = patches.point[here]
        x, y, z = point[0], point[1], point[2]
        dx, dy, dz = _lambert(faces, f, draws[k, 0], draws[k, 1])
    return count


@kernel
def _trace_particles(noted, faces, patches, boxes, walls, draws):
    count, particles = 0, draws.shape[1]
    for first in range(draws.shape[0]):
        f = patches.face[first]
        energy = (
            patches.area[first] * faces.kept[f] * patches.scattered[first] / (np.pi * particles)
        )
        for k in range(particles):
            count = _trace_particle(
                noted, count, faces, patches, boxes, walls, first, energy, draws[first, k]
            )
    return count
