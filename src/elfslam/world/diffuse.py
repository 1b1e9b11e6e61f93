"""The diffuse field at a phone: the room's chains of scatterings, summed coherently (kernels).

What a phone's place and motion change is worked out once for each patch; a chain then is a product
of three complex numbers, laid into a grid of eight columns per sample, and the pulse of all that
fell into a column is written at once. A patch alone is heard as several glints.
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy import fft

from elfslam.base.arrays import F64
from elfslam.world.acoustics import NEAREST_M
from elfslam.world.device import BAND_BINS
from elfslam.world.kernels import kernel
from elfslam.world.materials import Material
from elfslam.world.patches import OPEN_M
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers, image_echoes, one_phone, plain_rows
from elfslam.world.plan import PERSON_RADIUS_M, Sight, hides, look, make_sight
from elfslam.world.pulses import (
    BASEBAND_HZ,
    C64,
    CARRIER_AT_S,
    CARRIER_HZ,
    PAD,
    PHASES,
    SWEEP_RATE_HZ,
    TAPS,
    Air,
    lobed,
    pulse_table,
    shadow_of,
)
from elfslam.world.scattering import LONGEST_M, Scattering
from elfslam.world.scene import Scene

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


FINER = 8
"""Columns in a sample: their pulses are at most 11 degrees off at the edges of the band."""
SAMPLES = BAND_BINS + PAD // 2
PARTS = 4
"""In a column: the two of gains, and the two of gains times their falls."""
GLINTS = 5


class Ways(NamedTuple):
    """Between a transducer and each patch (p): delay in columns, gain with the carrier's phase,
    length and direction."""

    column: F64
    real: F64
    imag: F64
    length: F64
    direction: F64


class Links(NamedTuple):
    """Chains (c) in this air: delay in columns, gain with the carrier's phase, and its fall."""

    column: F64
    real: F64
    imag: F64
    fall: F64


class Glints(NamedTuple):
    """Glints of every patch (p, g): where they are from its point (m), and their signed gain."""

    offset: F64
    gain: F64


class Bench(NamedTuple):
    """Scratch of one thread; `grid` and `padded` have a real and an imaginary part, of gains and of
    gains times their falls."""

    there: Ways
    home: Ways
    grid: F64
    padded: F64
    sight: Sight
    crowd: Crowd
    to_crowd: Ways
    from_crowd: Ways


def diffuse_echoes(
    scene: Scene, ends: Transducers, people_m: F64, air: Air, reach: Reach, *,
    scattering: Scattering, threads: int = 1, person: Material | None = None,
) -> C64:  # fmt: skip
    """Mirror images and the diffuse field: envelopes (n, 630), the same for any threads.

    The scene's scattering points stand for what the field has, and are left out. People scatter
    as what a `person` is made of.
    """
    none = np.zeros((0, 3))
    bare = scene._replace(point=none, point_normal=none, point_radius=np.zeros(0))
    falling = np.zeros((len(ends.speaker), BAND_BINS), dtype=np.complex64)
    out = image_echoes(bare, ends, people_m, air, reach, threads, falling)
    add_diffuse(out, falling, scene, scattering, ends, people_m, air, threads, person)
    return tilted(out, falling, air)


def tilted(envelopes: C64, falling: C64, air: Air) -> C64:
    """What surfaces and air do to the sides of the band, which they damp unlike the carrier.

    What surfaces do is that of each path to first order: `falling` has every path times its fall.
    Sound that comes at t has gone c t through the air; its factor exp(-tilt f c t) is expanded to
    second order.
    """
    metres = (np.arange(BAND_BINS) / BASEBAND_HZ * air.speed_mps).astype(np.float32)
    frequency_hz = fft.fftfreq(BAND_BINS, 1 / BASEBAND_HZ).astype(np.float32)
    share = frequency_hz / np.float32(CARRIER_HZ)
    spectrum = fft.fft(envelopes, axis=1) - share * fft.fft(falling, axis=1)
    whole, first, second = (fft.ifft(spectrum * frequency_hz**k, axis=1) for k in range(3))
    taken = air.tilt_per_m_hz * metres
    return np.asarray(whole - taken * first + 0.5 * taken**2 * second, dtype=np.complex64)


def add_diffuse(
    out: C64, falling: C64, scene: Scene, scattering: Scattering, ends: Transducers, people_m: F64,
    air: Air, threads: int = 1, person: Material | None = None,
) -> None:  # fmt: skip
    """Adds the diffuse field to the envelopes (n, 630) of phones, the same for any threads.

    `falling` gets the same with each path times its fall. People scatter once, by Lambert's law,
    where it is said what a `person` is made of.
    """
    links, glints, table = _links(scattering, air), _glints(scattering), pulse_table()

    def render(rows: slice) -> None:
        crowd = make_crowd(people_m.shape[1], person)
        bench = _make_bench(len(scattering.once), len(scene.block_low), crowd)
        part, about = plain_rows(ends, rows), np.array(people_m[rows], dtype=np.float64)
        _render(
            out[rows], falling[rows], scene, scattering, links, glints, part, about, bench, air,
            table,
        )  # fmt: skip

    edges = np.linspace(0, len(out), max(min(threads, len(out)), 1) + 1).astype(int)
    parts = [slice(a, b) for a, b in pairwise(edges)]
    if len(parts) == 1:
        render(parts[0])
        return
    with ThreadPoolExecutor(len(parts)) as pool:
        list(pool.map(render, parts))


def _links(scattering: Scattering, air: Air) -> Links:
    chains = scattering.chains
    delay_s = chains.length / air.speed_mps
    damped = chains.gain * np.exp(-air.attenuation_per_m * chains.length)
    turned = damped * np.exp(-2j * np.pi * CARRIER_HZ * delay_s)
    column = delay_s * BASEBAND_HZ * FINER
    return Links(column, turned.real.copy(), turned.imag.copy(), chains.fall)


def _glints(scattering: Scattering) -> Glints:
    """The same for the same patches: their place in the face decides."""
    patches = scattering.patches
    turn = np.modf(np.abs(patches.point.sum(axis=1))[:, None] * 997 + np.arange(GLINTS) * 0.618)[0]
    side, angle = np.sqrt(patches.area)[:, None], 2 * np.pi * turn
    radius = 0.5 * side * np.sqrt((np.arange(GLINTS) + 0.5) / GLINTS)
    u, v = radius * np.cos(angle), radius * np.sin(angle)
    offset = u[..., None] * patches.along[:, None] + v[..., None] * patches.up[:, None]
    sign = np.where(turn < 0.5, -1.0, 1.0)
    return Glints(offset, sign * (scattering.once / np.sqrt(GLINTS))[:, None])


def _make_bench(patches: int, blocks: int, crowd: Crowd) -> Bench:
    def ways(count: int) -> Ways:
        column, real, imag, length = np.zeros((4, count))
        return Ways(column, real, imag, length, np.zeros((count, 3)))

    grid, padded = np.zeros((FINER, SAMPLES * PARTS)), np.zeros((BAND_BINS + 2 * PAD) * PARTS)
    return Bench(
        ways(patches), ways(patches), grid, padded, make_sight(blocks),
        crowd, ways(len(crowd.gain)), ways(len(crowd.gain)),
    )  # fmt: skip


@kernel
def _go(
    ways, k, patches, place, axis, directivity, across, lobe_share, ahead, velocity, held, air
):  # fmt: skip
    """The way between a transducer and patch k; of no gain where the patch looks elsewhere."""
    point, normal = patches.point[k], patches.normal[k]
    dx, dy, dz = point[0] - place[0], point[1] - place[1], point[2] - place[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-9
    dx, dy, dz = dx / length, dy / length, dz / length
    facing = -(normal[0] * dx + normal[1] * dy + normal[2] * dz)
    if facing <= 0.0:
        return
    gain = np.sqrt(facing) / max(length, NEAREST_M)
    gain *= np.exp(-air.attenuation_per_m * length)
    gain *= 1.0 - directivity + directivity * (axis[0] * dx + axis[1] * dy + axis[2] * dz)
    if lobe_share > 0.0:
        gain *= lobed(lobe_share, across[0], across[1], across[2], dx, dy, dz)
    if held:
        gain *= shadow_of(dx * ahead[0] + dy * ahead[1])
    shorter = (velocity[0] * dx + velocity[1] * dy + velocity[2] * dz) / air.speed_mps
    delay_s = length / air.speed_mps - shorter * CARRIER_AT_S
    turns = CARRIER_HZ * delay_s
    turns = 2.0 * np.pi * (turns - np.floor(turns))
    ways.column[k] = (delay_s - shorter / SWEEP_RATE_HZ) * BASEBAND_HZ * FINER
    ways.real[k], ways.imag[k] = gain * np.cos(turns), -gain * np.sin(turns)
    ways.length[k] = length
    ways.direction[k, 0], ways.direction[k, 1], ways.direction[k, 2] = dx, dy, dz


@kernel
def _go_to(there, home, k, patches, phone, air):
    _go(
        there, k, patches, phone.speaker, phone.speaker_axis, phone.speaker_directivity,
        phone.speaker_across, phone.speaker_lobe_share, phone.ahead,
        phone.speaker_velocity, phone.held, air,
    )  # fmt: skip
    _go(
        home, k, patches, phone.microphone, phone.microphone_axis, phone.microphone_directivity,
        phone.microphone_across, phone.microphone_lobe_share, phone.ahead,
        phone.microphone_velocity, phone.held, air,
    )  # fmt: skip


@kernel
def _go_both_ways(bench, scene, patches, phone, people, air):
    """All ways from the speaker and to the microphone, of what is seen from between the two."""
    s, m, there, home = phone.speaker, phone.microphone, bench.there, bench.home
    x, y, z = 0.5 * (s[0] + m[0]), 0.5 * (s[1] + m[1]), 0.5 * (s[2] + m[2])
    farthest = 0.5 * LONGEST_M
    look(scene, bench.sight, x, y, z, farthest)
    for k in range(patches.area.shape[0]):
        there.real[k] = there.imag[k] = home.real[k] = home.imag[k] = 0.0
        point, normal = patches.point[k], patches.normal[k]
        px, py, pz = point[0] - x, point[1] - y, point[2] - z
        if px * px + py * py + pz * pz > farthest * farthest:
            continue
        if px * normal[0] + py * normal[1] + pz * normal[2] >= 0.0:
            continue
        px, py = point[0] + OPEN_M * normal[0], point[1] + OPEN_M * normal[1]
        if hides(scene, people, bench.sight, px, py, point[2] + OPEN_M * normal[2]):
            continue
        _go_to(there, home, k, patches, phone, air)


@kernel
def _lay(grid, column, real, imag, fall):
    at = int(column + 0.5)
    sample = at // FINER
    fine, first = at - sample * FINER, PARTS * sample
    grid[fine, first] += real
    grid[fine, first + 1] += imag
    grid[fine, first + 2] += fall * real
    grid[fine, first + 3] += fall * imag


@kernel
def _lay_glints(bench, glints, k, column, real, imag, fall, air):
    """Patch k alone: its glints are a little nearer or farther than its point."""
    there, home, d, a = bench.there, bench.home, bench.there.direction[k], bench.home.direction[k]
    for g in range(GLINTS):
        o = glints.offset[k, g]
        out = o[0] * d[0] + o[1] * d[1] + o[2] * d[2]
        back = o[0] * a[0] + o[1] * a[1] + o[2] * a[2]
        square = o[0] * o[0] + o[1] * o[1] + o[2] * o[2]
        farther = out + 0.5 * (square - out * out) / there.length[k]
        farther += back + 0.5 * (square - back * back) / home.length[k]
        turns = farther * CARRIER_HZ / air.speed_mps
        turns = 2.0 * np.pi * (turns - np.floor(turns))
        cos, sin = glints.gain[k, g] * np.cos(turns), -glints.gain[k, g] * np.sin(turns)
        at = column + farther * (BASEBAND_HZ * FINER / air.speed_mps)
        if 0.0 < at < (SAMPLES - 1) * FINER:
            _lay(bench.grid, at, real * cos - imag * sin, real * sin + imag * cos, fall)


@kernel
def _lay_all(bench, scattering, links, glints, air):
    there, home, chains = bench.there, bench.home, scattering.chains
    latest = (SAMPLES - 1) * FINER
    for k in range(scattering.once.shape[0]):
        sr, si = there.real[k], there.imag[k]
        if sr == 0.0 and si == 0.0:
            continue
        begun, hr, hi = there.column[k], home.real[k], home.imag[k]
        if hr != 0.0 or hi != 0.0:
            column, fall = begun + home.column[k], scattering.patches.diffuse_fall[k]
            _lay_glints(bench, glints, k, column, sr * hr - si * hi, sr * hi + si * hr, fall, air)
        for c in range(chains.start[k], chains.start[k + 1]):
            column = begun + links.column[c]
            if column > latest:
                break
            j = chains.to[c]
            hr, hi = home.real[j], home.imag[j]
            column += home.column[j]
            if column >= latest or (hr == 0.0 and hi == 0.0):
                continue
            r = sr * links.real[c] - si * links.imag[c]
            i = sr * links.imag[c] + si * links.real[c]
            _lay(bench.grid, column, r * hr - i * hi, r * hi + i * hr, links.fall[c])


@kernel
def _lay_people(bench, scene, phone, people, air):
    """What the people about return, as far as they are seen from between speaker and microphone."""
    crowd, there, home = bench.crowd, bench.to_crowd, bench.from_crowd
    stand(crowd, people)
    for k in range(crowd.gain.shape[0]):
        there.real[k] = there.imag[k] = home.real[k] = home.imag[k] = 0.0
        point, normal = crowd.point[k], crowd.normal[k]
        x, y = point[0] + OPEN_M * normal[0], point[1] + OPEN_M * normal[1]
        if hides(scene, people, bench.sight, x, y, point[2]):
            continue
        _go_to(there, home, k, crowd, phone, air)
        column = there.column[k] + home.column[k]
        if 0.0 < column < (SAMPLES - 1) * FINER and there.length[k] + home.length[k] < LONGEST_M:
            sr, si = crowd.gain[k] * there.real[k], crowd.gain[k] * there.imag[k]
            hr, hi = home.real[k], home.imag[k]
            _lay(bench.grid, column, sr * hr - si * hi, sr * hi + si * hr, crowd.fall)


@kernel
def _write(out, falling, bench, table):
    grid, padded = bench.grid, bench.padded
    padded[:] = 0.0
    for fine in range(FINER):
        for tap in range(TAPS):
            pulse = table[fine * (PHASES // FINER), tap]
            first = PARTS * (PAD - TAPS // 2 + 1 + tap)
            for k in range(PARTS * SAMPLES):
                padded[first + k] += pulse * grid[fine, k]
    for k in range(BAND_BINS):
        at = PARTS * (PAD + k)
        out[k] += complex(padded[at], padded[at + 1])
        falling[k] += complex(padded[at + 2], padded[at + 3])


@kernel
def _render(out, falling, scene, scattering, links, glints, ends, people, bench, air, table):
    for row in range(out.shape[0]):
        phone = one_phone(ends, row)
        bench.grid[:] = 0.0
        _go_both_ways(bench, scene, scattering.patches, phone, people[row], air)
        _lay_all(bench, scattering, links, glints, air)
        _lay_people(bench, scene, phone, people[row], air)
        _write(out[row], falling[row], bench, table)
