"""Points on people that scatter: where they are once everybody stands somewhere (kernels)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F64
from elfslam.world.kernels import kernel
from elfslam.world.materials import Material
from elfslam.world.plan import PERSON_RADIUS_M

POINTS = 12
"""On each person; about half of them look at a phone."""
SCATTERING_M = (0.4, 1.6)
"""Heights between which people scatter."""
DRAWS = 20
"""Of a person, beside their number."""


class Crowd(NamedTuple):
    """Points on people (p times 12): the way they look (3), height, signed gain as of a patch, and
    where they are (3) about one phone. All gains `fall` with this power of the frequency."""

    normal: F64
    height: F64
    gain: F64
    point: F64
    fall: float


def make_crowd(people: int, person: Material | None) -> Crowd:
    """People of a material, who stand nowhere yet; without one they have no points.

    Bearings, heights and signs are fixed for ever for the first person, the second and so on.
    Together the points scatter what an upright cylinder does between these heights.
    """
    if person is None or not people:
        return Crowd(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros((0, 3)), 0.0)
    shape = POINTS, 3
    draws = np.array([np.random.default_rng([DRAWS, k]).uniform(size=shape) for k in range(people)])
    turn = (2 * np.pi / POINTS * (np.arange(POINTS) + draws[..., 0])).ravel()
    low, high = SCATTERING_M
    area_m2 = 2 * np.pi * PERSON_RADIUS_M * (high - low) / POINTS
    gain = np.sqrt(area_m2 * person.diffuse / np.pi)
    return Crowd(
        normal=np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)]),
        height=low + (high - low) * draws[..., 1].ravel(),
        gain=np.where(draws[..., 2].ravel() < 0.5, -gain, gain),
        point=np.zeros((len(turn), 3)),
        fall=person.diffuse_fall,
    )


@kernel
def stand(crowd, people):
    """Puts the points where the people (p, 2) are."""
    for k in range(crowd.gain.shape[0]):
        person = people[k // POINTS]
        crowd.point[k, 0] = person[0] + PERSON_RADIUS_M * crowd.normal[k, 0]
        crowd.point[k, 1] = person[1] + PERSON_RADIUS_M * crowd.normal[k, 1]
        crowd.point[k, 2] = crowd.height[k]
