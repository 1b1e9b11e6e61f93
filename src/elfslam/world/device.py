"""Phones: the sound they make, hear and the errors of their motion sensors."""

import difflib
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from elfslam.base.arrays import F64, Value, array
from elfslam.base.errors import InputError
from elfslam.world.transducers import (
    HAND,
    HEARD_HZ,
    GainControl,
    Lobes,
    NearField,
    Resonance,
    ordinary_traits,
    ringing,
    traits_of_another,
    traits_of_one,
)

BAND_LOW_HZ = 14_350.0
BAND_BINS = 630
BIN_HZ = 10.0
"""The simulator works on 630 bins of 10 Hz, 14.35 to 20.65 kHz: one 100 ms frame at 6.3 kHz."""


@dataclass(frozen=True)
class ImuGrade:
    """Errors of a motion sensor, one standard deviation each.

    A bias instability is the flat floor of the Allan deviation. `decimals` is to how many places
    the stream is rounded, in m/s2 and degrees per second; None leaves it as it is.
    """

    name: str
    rate_hz: float
    gyro_noise_radps_rthz: float
    gyro_bias_radps: float
    accel_noise_mps2_rthz: float
    accel_bias_mps2: float
    gyro_bias_instability_radps: float = 0.0
    decimals: int | None = None


BMI160 = ImuGrade(
    name="Bosch BMI160",
    rate_hz=100.0,
    gyro_noise_radps_rthz=np.deg2rad(0.007),
    gyro_bias_radps=np.deg2rad(0.1),
    accel_noise_mps2_rthz=180e-6 * 9.80665,
    accel_bias_mps2=0.040 * 9.80665,
)
"""Data sheet BST-BMI160-DS000: gyroscope noise 0.007 deg/s/rtHz, accelerometer noise 180 ug/rtHz
and offset 40 mg. The gyroscope's zero-rate offset drifts by 0.05 deg/s per kelvin; the phone's own
calibration removes it at rest, and 0.1 deg/s stands for 2 K of warming since then."""

PHONE_BIAS_INSTABILITY_RADPS = np.deg2rad(10.0 / 3600)
"""No data sheet below states one. Eleven Android phones had gyroscope biases of 5 to 20 deg/h
(doi 10.12265/j.gnss.2025047); 10 deg/h stands for them."""

LSM6DSO = ImuGrade(
    name="ST LSM6DSO",
    rate_hz=100.0,
    gyro_noise_radps_rthz=np.deg2rad(0.0038),
    gyro_bias_radps=np.deg2rad(0.02),
    accel_noise_mps2_rthz=70e-6 * 9.80665,
    accel_bias_mps2=0.020 * 9.80665,
    gyro_bias_instability_radps=PHONE_BIAS_INSTABILITY_RADPS,
)
"""Data sheet DS12140, table of mechanical characteristics: 3.8 mdps/rtHz, 70 ug/rtHz at 2 g, zero-g
offset 20 mg, zero-rate change 0.010 deg/s per kelvin (here times 2 K)."""

ICM20948 = ImuGrade(
    name="TDK InvenSense ICM-20948",
    rate_hz=100.0,
    gyro_noise_radps_rthz=np.deg2rad(0.015),
    gyro_bias_radps=np.deg2rad(0.1),
    accel_noise_mps2_rthz=230e-6 * 9.80665,
    accel_bias_mps2=0.025 * 9.80665,
    gyro_bias_instability_radps=PHONE_BIAS_INSTABILITY_RADPS,
)
"""Data sheet DS-000189 revision 1.3, tables 1 and 2: 0.015 deg/s/rtHz, 230 ug/rtHz, zero-g offset
25 mg (component), zero-rate change 0.05 deg/s per kelvin (here times 2 K)."""

BROWSER = replace(BMI160, name="browser on Bosch BMI160", rate_hz=60.0, decimals=1)
"""What a page gets by devicemotion: 60 Hz, rounded to 0.1 m/s2 and 0.1 deg/s."""

GRADES: Mapping[str, ImuGrade] = MappingProxyType(
    {"BMI160": BMI160, "LSM6DSO": LSM6DSO, "ICM20948": ICM20948, "browser": BROWSER}
)
"""The motion sensors by short names."""


def _vector(x: float, y: float, z: float, *, unit: bool = False) -> Any:
    declared = array(3, unit_rows=unit)
    return field(default_factory=lambda: np.array([x, y, z]), metadata=declared.metadata)


@dataclass(frozen=True, eq=False)
class Device(Value):
    """An acoustic phone: a loudspeaker and a microphone with response and directivity.

    Its axes are x to the right of the screen, y up the screen (forward) and z out of it; positions
    are from the phone's centre. `response` is the product of both transducers over the 630 bins.
    A directivity b gives the gain (1 - b) + b cos(angle to the transducer's axis), which the lobes
    cut up. `level` scales
    all that is played, and the direct sound arrives with `direct_gain` / `separation_m` of it. The
    recorder adds white noise of `noise_rms` and clips at `clip_level`; its clock runs fast by
    `clock_skew_ppm` against the player's. A chirp leaves off its time by `jitter_s` (one sigma).
    Both transducers together ring as `ringing` says, and the holder scatters far sound by the
    `near_field`. What is recorded passes the `gain_control`.
    Raises InputError where both transducers are at one place or a magnitude is negative.
    """

    name: str
    response: F64 = array(BAND_BINS)
    speaker_m: F64 = _vector(0.0, 0.075, 0.0)
    microphone_m: F64 = _vector(0.0, -0.075, 0.0)
    speaker_axis: F64 = _vector(0.0, 1.0, 0.0, unit=True)
    microphone_axis: F64 = _vector(0.0, 1.0, 0.0, unit=True)
    speaker_directivity: float = 0.35
    microphone_directivity: float = 0.2
    direct_gain: float = 0.6
    level: float = 0.035
    noise_rms: float = 2e-5
    clip_level: float = 1.0
    clock_skew_ppm: float = 0.0
    jitter_s: float = 0.0
    ringing: tuple[Resonance, ...] = ()
    speaker_lobes: Lobes = field(default_factory=Lobes)
    microphone_lobes: Lobes = field(default_factory=Lobes)
    gain_control: GainControl | None = None
    near_field: NearField | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.separation_m == 0:
            raise InputError(
                f"device {self.name!r}: speaker and microphone are at one place; move one of them"
            )
        if self.clip_level <= 0 or min(self.noise_rms, self.jitter_s, self.level) < 0:
            raise InputError(
                f"device {self.name!r}: wanted a positive clip level and no negative noise, jitter "
                "or level; correct it"
            )

    @property
    def separation_m(self) -> float:
        """Distance of the microphone from the loudspeaker."""
        return math.dist(self.speaker_m, self.microphone_m)


def band_hz() -> F64:
    """Frequency of each of the 630 bins."""
    return np.asarray(BAND_LOW_HZ + BIN_HZ * np.arange(BAND_BINS), dtype=np.float64)


def smooth_response(generator: np.random.Generator, ripple_db: float, bumps: int = 5) -> F64:
    """A random smooth response (630) whose ripple spans about `ripple_db` from peak to peak."""
    x = np.linspace(0.0, 1.0, BAND_BINS)
    order = np.arange(1, bumps + 1)
    weights = generator.standard_normal(bumps) / order**0.5
    phase = generator.uniform(0, 2 * np.pi, bumps)
    curve = (weights[:, None] * np.cos(np.pi * order[:, None] * x + phase[:, None])).sum(axis=0)
    curve = (curve - curve.mean()) / max(float(np.ptp(curve)), 1e-9) * ripple_db
    return np.asarray(10 ** (curve / 20))


def random_device(generator: np.random.Generator, *, ordinary: bool = False) -> Device:
    """A phone of random response, directivity, level, noise, geometry and clock.

    An `ordinary` one also rings, has lobes and a holder, may ride its gain, and hears itself, the
    room and its noise about as loud as one of the measured phones that hear the room at all. What
    came later is drawn from a child of `generator`, which leaves its own stream as it was.
    """
    early = Device(
        name="random",
        response=smooth_response(generator, generator.uniform(2.0, 25.0)),
        speaker_directivity=generator.uniform(0.2, 0.5),
        microphone_directivity=generator.uniform(0.0, 0.4),
        direct_gain=generator.uniform(0.4, 1.0),
        noise_rms=float(np.exp(generator.uniform(np.log(5e-6), np.log(1e-4)))),
    )
    child = generator.spawn(1)[0]
    half_m = child.uniform(0.05, 0.12)
    across_m = child.uniform(-0.02, 0.02, 2)
    late = replace(
        early,
        speaker_m=np.array([across_m[0], half_m, 0.0]),
        microphone_m=np.array([across_m[1], -half_m, 0.0]),
        clock_skew_ppm=child.uniform(-30.0, 30.0),
        jitter_s=child.uniform(0.0, 20e-6),
    )
    if not ordinary:
        return late
    like = HEARING[child.integers(len(HEARING))]
    echo_db, noise_db = child.normal([like.echo_db, like.noise_db], SPREAD_DB)
    return as_loud(replace(late, **ordinary_traits(child)), echo_db, noise_db)


ROOM_ECHO_DB = -27.0
"""Of a room of 50 to 60 m2 (`studio` and `lounge`), 11 to 20 ms after the direct sound: rms of
diffuse sound from all sides beside the peak of the direct sound 1 m away."""
CHIRP_GAIN_DB = 23.2
"""What pulse compression gains: the energy of the chirp at 48 kHz over that of one sample."""
FULLEST = 0.5
"""Of full scale, for the direct sound and four sigma of the noise."""


def as_loud(phone: Device, echo_db: float, noise_db: float) -> Device:
    """The phone, so that it hears the echoes of a room and the noise of a chirp so loud.

    Both are against the peak of its direct sound, the noise after pulse compression.
    """
    direct_db = ROOM_ECHO_DB + _diffuse_gain_db(phone) - echo_db
    direct = 10 ** (direct_db / 20)
    heard = (band_hz() >= HEARD_HZ[0]) & (band_hz() <= HEARD_HZ[1])
    gain = np.abs(phone.response * ringing(phone.ringing, band_hz()))[heard]
    loud, typical = direct * float(gain.max()), direct * float(np.sqrt(np.mean(gain**2)))
    noise = typical * 10 ** ((noise_db + CHIRP_GAIN_DB) / 20)
    level = FULLEST / (loud + 4 * noise)
    return replace(
        phone, direct_gain=direct * phone.separation_m, level=level, noise_rms=level * noise
    )


def _diffuse_gain_db(phone: Device) -> float:
    """Of diffuse sound by both transducers: the mean power of their directions, and the holder."""
    power = 1 + (phone.near_field.gain**2 if phone.near_field else 0.0)
    for beam, lobes in (
        (phone.speaker_directivity, phone.speaker_lobes),
        (phone.microphone_directivity, phone.microphone_lobes),
    ):
        power *= (1 - beam) ** 2 + beam**2 / 3
        power *= (1 - lobes.share) ** 2 + lobes.share**2 / 2
    return float(10 * np.log10(power))


class MeasuredPhone(NamedTuple):
    """A microphone of a phone, as measured in a set-up: levels over the peak of its direct sound.

    `echo_db` is the rms of 11 to 20 ms, `noise_db` that of a compressed chirp of 10 ms;
    `response_db` is the spectrum of the echoes at 15, 16 ... 20 kHz about its mean, less what the
    air takes.
    """

    setup: str
    echo_db: float
    noise_db: float
    response_db: tuple[float, ...]


MEASURED: Mapping[str, MeasuredPhone] = MappingProxyType(
    {
        "iphone 5c up": MeasuredPhone(
            "iphone5c_up, 0", -41.2, -36.9, (1.5, 1.1, 0.7, 0.0, 0.0, -3.3)
        ),
        "iphone 5c down": MeasuredPhone(
            "iphone5c_down, 0", -49.3, -35.7, (3.6, 1.3, -0.6, 0.4, 2.0, -6.6)
        ),
        "iphone 5c up in hand": MeasuredPhone(
            "iphone5c_up_onhand, 0", -41.2, 19.5, (1.5, 1.1, 0.7, 0.0, 0.0, -3.3)
        ),
        "iphone 5c down in hand": MeasuredPhone(
            "iphone5c_down_onhand, 0", -49.3, 24.9, (3.6, 1.3, -0.6, 0.4, 2.0, -6.6)
        ),
        "galaxy s4 cam 0": MeasuredPhone(
            "s4_cam_onhand, 0", -34.9, -17.9, (1.3, 0.0, -1.3, -2.3, 0.4, 1.9)
        ),
        "galaxy s4 cam 1": MeasuredPhone(
            "s4_cam_onhand, 1", -59.6, -61.3, (6.6, 3.1, 1.4, -0.7, -4.0, -6.3)
        ),
        "galaxy s4 mic 0": MeasuredPhone(
            "s4_mic_onhand, 0", -56.1, -61.4, (6.6, 2.0, 0.5, -2.3, -2.2, -4.6)
        ),
        "galaxy s4 mic 1": MeasuredPhone(
            "s4_mic_onhand, 1", -30.7, -47.3, (3.7, 0.5, -0.6, -0.9, -1.2, -1.3)
        ),
        "galaxy s4 recog 0": MeasuredPhone(
            "s4_recog_onhand, 0", -53.9, -63.3, (6.3, 2.3, -0.3, -2.8, -3.8, -1.7)
        ),
        "galaxy s4 recog 1": MeasuredPhone(
            "s4_recog_onhand, 1", -28.3, -46.2, (3.0, 1.1, -2.7, -0.4, -1.3, 0.3)
        ),
        "galaxy s5 mic 0": MeasuredPhone(
            "s5_mic_onhand, 0", -38.0, -42.0, (3.1, 1.0, -1.3, 0.6, -0.4, -3.1)
        ),
        "galaxy s5 mic 1": MeasuredPhone(
            "s5_mic_onhand, 1", -41.7, -44.4, (3.1, -0.3, -1.1, 1.4, 0.3, -3.3)
        ),
        "galaxy s5 recog": MeasuredPhone(
            "s5_recog_onhand, 0", -30.7, -35.5, (3.1, 1.5, 0.1, -1.6, -1.3, -1.9)
        ),
    }
)
"""By phone, audio source of Android (camcorder, microphone, voice recognition) and microphone;
`python -m studies phones`, by recordings of LibAcousticSensing (MIT). Some recordings clip, and
distortion counts as noise. Under a hand on the iPhone's microphone nothing but noise was heard:
echo and response are those of the free one. Both channels of the S5's recogniser are one."""
HEARING = tuple(each for each in MEASURED.values() if each.echo_db > each.noise_db)
"""Those whose echoes lie above the noise of a chirp: what is drawn is to be learnt from."""
SPREAD_DB = 2.0
"""Of drawn phones about the measured one that they are like, one standard deviation."""


def _as_measured(name: str, known: MeasuredPhone) -> Device:
    response_db = np.interp(band_hz(), 1000.0 * np.arange(15, 21), known.response_db)
    held = Device(name, np.asarray(10 ** (response_db / 20)), near_field=HAND)
    return as_loud(held, known.echo_db, known.noise_db)


def _fixed_response(seed: int, ripple_db: float) -> F64:
    return smooth_response(np.random.default_rng(seed), ripple_db)


DEVICES: Mapping[str, Device] = MappingProxyType(
    {
        device.name: device
        for device in (
            Device("simulated phone", _fixed_response(160, 10.0)),
            Device("flat", np.ones(BAND_BINS)),
            Device("rippled", _fixed_response(161, 30.0)),
            # Falls by 10 dB per kHz above 18 kHz.
            Device(
                "cheap",
                _fixed_response(162, 12.0)
                * 10 ** (-(np.maximum(band_hz() - 18_000.0, 0.0) / 1000.0 * 10.0) / 20),
                noise_rms=1e-4,
                clock_skew_ppm=20.0,
            ),
            Device(
                "tablet",
                _fixed_response(163, 15.0),
                speaker_m=np.array([0.0, 0.12, 0.0]),
                microphone_m=np.array([0.0, -0.12, 0.0]),
            ),
            # Both at the edge that faces the holder, and not to each other: hence little direct.
            Device(
                "bottom-fired",
                _fixed_response(164, 12.0),
                speaker_m=np.array([0.0125, -0.075, 0.0]),
                microphone_m=np.array([-0.0125, -0.075, 0.0]),
                speaker_axis=np.array([0.0, -1.0, 0.0]),
                microphone_axis=np.array([0.0, -1.0, 0.0]),
                direct_gain=0.15,
            ),
            # As real ones: it rings for half a millisecond, has lobes, and hears its own noise.
            Device(
                "ordinary phone",
                _fixed_response(165, 10.0),
                speaker_m=np.array([0.006, 0.074, 0.0]),
                microphone_m=np.array([-0.012, -0.076, 0.0]),
                speaker_directivity=0.4,
                clock_skew_ppm=8.0,
                jitter_s=5e-6,
                noise_rms=3.6e-4,
                **traits_of_one(),
            ),
            # Another of them, which rides its gain.
            Device(
                "other ordinary phone",
                _fixed_response(166, 14.0),
                speaker_m=np.array([-0.010, 0.078, 0.0]),
                microphone_m=np.array([0.008, -0.072, 0.0]),
                microphone_directivity=0.3,
                direct_gain=0.8,
                clock_skew_ppm=-12.0,
                jitter_s=10e-6,
                noise_rms=7e-4,
                **traits_of_another(),
            ),
            *(_as_measured(*each) for each in MEASURED.items()),
        )
    }
)
"""The built-in phones by name; all but the measured ones are fixed for all time."""


def built_in_device(name: str) -> Device:
    """The built-in phone of this name. Raises InputError that suggests a near name for others."""
    _check_known("device", name, DEVICES)
    return DEVICES[name]


def built_in_grade(name: str) -> ImuGrade:
    """The motion sensor of this short name. Raises InputError that suggests a near one."""
    _check_known("imu", name, GRADES)
    return GRADES[name]


def _check_known(kind: str, name: str, known: Collection[str]) -> None:
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        advice = f"did you mean {near[0]!r}?" if near else "choose one of them"
        raise InputError(f"{kind} {name!r}: wanted {', '.join(known)}; {advice}")


def named_device(name: str) -> Device:
    """The built-in phone of this name, or the simulated phone under another name."""
    return DEVICES.get(name) or replace(DEVICES["simulated phone"], name=name)
