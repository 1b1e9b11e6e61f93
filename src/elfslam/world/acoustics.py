"""Echo synthesis: image sources, clutter, edges and people, one band-limited pulse per path.

Paths are found in plan (`paths.py`) and repeated here for the images in height. Image method after
Allen and Berkley (J. Acoust. Soc. Am. 65, 1979). Every row is one phone at one moment; rows do not
depend on each other, so that cores share them and the result is the same.
"""

import numpy as np

from elfslam.world.kernels import kernel
from elfslam.world.paths import MOST_BOUNCES, find_paths
from elfslam.world.plan import PERSON_HEIGHT_M, PERSON_RADIUS_M, hides, look
from elfslam.world.pulses import MOST_RAYS, note_ray, write_rays
from elfslam.world.scene import EDGE_GAIN

PERSON_REFLECTION = 0.6
CLUTTER_REACH_M = 7.0
"""From farther away clutter and edges return 30 dB less than the walls' images do by then."""
NEAREST_M = 0.3
"""Spreading laws of small things hold from here on."""


@kernel
def _stands_in(height, enter, leave, low, high):
    """Whether a line between two unfolded heights passes an obstacle between floor and ceiling.

    Floor at 0 and ceiling at `height` are mirrors: the obstacle and its images lie every 2 height.
    """
    bottom, top = min(enter, leave), max(enter, leave)
    period = 2.0 * height
    k = np.floor((bottom + high) / period) * period
    while k + low < top or k - high < top:
        if (k + low < top and k + high > bottom) or (k - high < top and k - low > bottom):
            return True
        k += period
    return False


@kernel
def _folded(height, z):
    z = z % (2.0 * height)
    return min(z, 2.0 * height - z)


@kernel
def _is_open(scene, paths, p, base, start, slope):
    """Whether plan path p is free for a line from height `start` above `base` at this slope."""
    height = scene.height - base
    first = paths.crossing_end[p - 1] if p > 0 else 0
    crossings = paths.crossings
    for c in range(first, paths.crossing_end[p]):
        high = min(crossings.high[c] - base, height)
        if high <= 1e-9:
            continue
        enter, leave = start + slope * crossings.enter[c], start + slope * crossings.leave[c]
        if _stands_in(height, enter, leave, max(crossings.low[c] - base, 0.0), high):
            return False
    for hit in range(paths.order[p]):
        k = paths.hit_block[p, hit]
        if k >= 0:
            z = base + _folded(height, start + slope * paths.hit_at[p, hit])
            if z < scene.block_low[k] or z > scene.block_high[k]:
                return False
    return True


@kernel
def _raise_powers(powers, gain):
    powers[0] = 1.0
    for k in range(1, powers.shape[0]):
        powers[k] = powers[k - 1] * gain


@kernel
def _add_lifted(rays, phone, paths, p, gain, fall, image, seen):
    """Adds plan path p with the heights of the speaker's image and of the microphone's."""
    rise = image - phone.microphone[2]
    plan = paths.length[p]
    length = np.sqrt(plan * plan + rise * rise)
    inverse = 1.0 / max(length, 1e-3)
    flat = plan * inverse
    note_ray(
        rays, length, gain * paths.gain[p] * inverse, fall + paths.fall[p],
        paths.departure[p, 0] * flat, paths.departure[p, 1] * flat,
        (seen - phone.speaker[2]) * inverse,
        paths.arrival[p, 0] * flat, paths.arrival[p, 1] * flat, rise * inverse,
    )  # fmt: skip


@kernel
def _heights(rays, scene, phone, paths, p, reach):
    """Plan path p with every number of reflections at floor and ceiling."""
    plan, order = paths.length[p], paths.order[p]
    height, start, end = scene.height, phone.speaker[2], phone.microphone[2]
    most = min(int(reach.longest_m / (2.0 * height)) + 1, MOST_BOUNCES - 1)
    for n in range(-most, most + 1):
        for odd in range(2):
            bounces = abs(n - odd) + abs(n)
            if order + bounces > reach.order or (order + bounces == 0 and phone.held):
                continue
            sign = 1.0 - 2.0 * odd
            image = sign * start + 2.0 * n * height
            rise = image - end
            if plan * plan + rise * rise > reach.longest_m * reach.longest_m:
                continue
            seen = sign * (end - 2.0 * n * height)
            if _is_open(scene, paths, p, 0.0, start, (seen - start) / max(plan, 1e-9)):
                gain = paths.floor_power[abs(n - odd)] * paths.ceiling_power[abs(n)]
                fall = abs(n - odd) * scene.floor_fall + abs(n) * scene.ceiling_fall
                _add_lifted(rays, phone, paths, p, gain, fall, image, seen)


@kernel
def _tops(rays, scene, phone, paths, p, reach):
    """Plan path p with one reflection at the top of a block that it passes over.

    Between this top and the ceiling the same images hold, with the top as the floor.
    """
    first = paths.crossing_end[p - 1] if p > 0 else 0
    start, end, plan = phone.speaker[2], phone.microphone[2], paths.length[p]
    for c in range(first, paths.crossing_end[p]):
        base, top_gain = paths.crossings.high[c], paths.crossings.top_gain[c]
        if top_gain <= 0.0 or base >= min(start, end):
            continue
        height = scene.height - base
        for odd, n, touch in ((1, 0, 0.0), (0, 1, 0.0), (0, -1, 2.0), (1, 2, 2.0)):
            if paths.order[p] + 1 + abs(n) > reach.order:
                continue
            sign = 1.0 - 2.0 * odd
            image = sign * (start - base) + 2.0 * n * height
            rise = image - (end - base)
            if plan * plan + rise * rise > reach.longest_m * reach.longest_m:
                continue
            seen = sign * (end - base - 2.0 * n * height)
            slope = (seen - start + base) / max(plan, 1e-9)
            at = (touch * height - start + base) / slope
            if at < paths.crossings.enter[c] or at > paths.crossings.leave[c]:
                continue
            if _is_open(scene, paths, p, base, start - base, slope):
                gain = top_gain * paths.ceiling_power[abs(n)]
                fall = paths.crossings.top_fall[c] + abs(n) * scene.ceiling_fall
                _add_lifted(rays, phone, paths, p, gain, fall, image + base, seen + base)


@kernel
def _look(scene, phone, paths, reach):
    """What a held phone sees is looked up once, from between its two transducers."""
    s, m = phone.speaker, phone.microphone
    if phone.held:
        x, y, z = 0.5 * (s[0] + m[0]), 0.5 * (s[1] + m[1]), 0.5 * (s[2] + m[2])
        look(scene, paths.from_speaker, x, y, z, 0.5 * reach.longest_m)
    else:
        look(scene, paths.from_speaker, s[0], s[1], s[2], reach.longest_m)
        look(scene, paths.from_microphone, m[0], m[1], m[2], reach.longest_m)


@kernel
def _via(rays, scene, phone, people, paths, x, y, z, strength, reach):
    """Adds the path over a small thing at (x, y, z), unless it is out of reach or hidden.

    The pressure it returns at distances there and home is `strength` / (there home).
    """
    s, m = phone.speaker, phone.microphone
    dx, dy, dz = x - s[0], y - s[1], z - s[2]
    ax, ay, az = x - m[0], y - m[1], z - m[2]
    there = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-9
    home = np.sqrt(ax * ax + ay * ay + az * az) + 1e-9
    if there + home > reach.longest_m:
        return
    if hides(scene, people, paths.from_speaker, x, y, z):
        return
    if not phone.held and hides(scene, people, paths.from_microphone, x, y, z):
        return
    gain = strength / (max(there, NEAREST_M) * max(home, NEAREST_M))
    note_ray(
        rays, there + home, gain, 0.0, dx / there, dy / there, dz / there,
        ax / home, ay / home, az / home,
    )  # fmt: skip


@kernel
def _clutter(rays, scene, phone, people, paths, reach):
    """Points on faces that look towards the phone; a point of radius a returns a / 2 at 1 m."""
    mx = 0.5 * (phone.speaker[0] + phone.microphone[0])
    my = 0.5 * (phone.speaker[1] + phone.microphone[1])
    mz = 0.5 * (phone.speaker[2] + phone.microphone[2])
    farthest = min(0.5 * reach.longest_m, CLUTTER_REACH_M)
    for k in range(scene.point_radius.shape[0]):
        point, normal = scene.point[k], scene.point_normal[k]
        x, y, z = mx - point[0], my - point[1], mz - point[2]
        towards = normal[0] * x + normal[1] * y + normal[2] * z
        square = x * x + y * y + z * z
        if towards <= 0.0 or square > farthest * farthest:
            continue
        facing = min(2.0 * towards / np.sqrt(square), 1.0)
        strength = 0.5 * scene.point_radius[k] * facing
        x, y, z = point[0], point[1], point[2]
        _via(rays, scene, phone, people, paths, x, y, z, strength, reach)


@kernel
def _edges(rays, scene, phone, people, paths, reach):
    """The nearest point of every edge that has one between its ends."""
    m, s = phone.microphone, phone.speaker
    for k in range(scene.edge_a.shape[0]):
        a, b, normal = scene.edge_a[k], scene.edge_b[k], scene.edge_normal[k]
        along, size, facing = 0.0, 0.0, 0.0
        for i in range(3):
            middle = 0.5 * (m[i] + s[i])
            along += (middle - a[i]) * (b[i] - a[i])
            size += (b[i] - a[i]) ** 2
            facing += (middle - a[i]) * normal[i]
        share = along / size
        if share <= 0.0 or share >= 1.0 or facing <= 0.0:
            continue
        x = a[0] + share * (b[0] - a[0]) + 0.005 * normal[0]
        y = a[1] + share * (b[1] - a[1]) + 0.005 * normal[1]
        z = a[2] + share * (b[2] - a[2]) + 0.005 * normal[2]
        there = np.sqrt((x - s[0]) ** 2 + (y - s[1]) ** 2 + (z - s[2]) ** 2)
        if there > CLUTTER_REACH_M:
            continue
        home = np.sqrt((x - m[0]) ** 2 + (y - m[1]) ** 2 + (z - m[2]) ** 2)
        spread = max(there, NEAREST_M) * max(home, NEAREST_M)
        strength = EDGE_GAIN * np.sqrt(spread / (there + home + 1e-9))
        _via(rays, scene, phone, people, paths, x, y, z, strength, reach)


@kernel
def _people(rays, scene, phone, people, paths, reach):
    """Specular reflection of upright cylinders, weaker than a wall's by their curvature."""
    for k in range(people.shape[0]):
        x = 0.5 * (phone.speaker[0] + phone.microphone[0]) - people[k, 0]
        y = 0.5 * (phone.speaker[1] + phone.microphone[1]) - people[k, 1]
        distance = np.sqrt(x * x + y * y)
        z = min(0.5 * (phone.speaker[2] + phone.microphone[2]), PERSON_HEIGHT_M)
        gap = distance - PERSON_RADIUS_M
        if gap <= 0.02:
            continue
        outward = (PERSON_RADIUS_M + 0.005) / distance
        curved = 1.0 / np.sqrt(1.0 + gap / PERSON_RADIUS_M)
        strength = PERSON_REFLECTION * curved * 0.5 * gap
        _via(
            rays, scene, phone, people, paths, people[k, 0] + x * outward,
            people[k, 1] + y * outward, z, strength, reach,
        )  # fmt: skip


@kernel
def add_echoes(out, falling, scene, phone, people, paths, rays, reach, air, table):
    """Writes all that one phone hears of an impulse to `out` (630); False where it does not fit.

    The direct sound comes only with phones that nobody holds: a held one adds its near field
    itself. `falling` (630, or nobody asks: 0) gets the same with each path times its fall.
    """
    rays.filled[0] = 0
    _look(scene, phone, paths, reach)
    _raise_powers(paths.floor_power, scene.floor_gain)
    _raise_powers(paths.ceiling_power, scene.ceiling_gain)
    count = find_paths(scene, people, paths, phone.speaker, phone.microphone, reach)
    for p in range(count):
        _heights(rays, scene, phone, paths, p, reach)
        _tops(rays, scene, phone, paths, p, reach)
    _clutter(rays, scene, phone, people, paths, reach)
    _edges(rays, scene, phone, people, paths, reach)
    _people(rays, scene, phone, people, paths, reach)
    fits = count >= 0 and rays.filled[0] < MOST_RAYS
    write_rays(out, falling, rays, phone, air, table)
    return fits
