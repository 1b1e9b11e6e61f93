"""A recording cropped to a stretch of itself, once, when it is taken up."""

from dataclasses import replace

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Recording
from elfslam.slam.coverage import duration_s, motion_times_s

SLIGHT_S = 0.15
"""Sound that differs by no more from the motion in length lacks nothing that matters."""


def crop(recording: Recording, from_s: float, until_s: float) -> Recording:
    """The recording between two times, which stay those of the whole.

    Whoever was declared to stand somewhere did so when the whole began: a stretch that begins
    later has no declared start. When motion was measured in the whole stays known: it tells how
    much sound was lost. Raises InputError without motion in the stretch.
    """
    imu, odometry = recording.imu, recording.odometry
    imu = imu and imu.chosen((imu.t_s >= from_s) & (imu.t_s <= until_s))
    odometry = odometry and odometry.chosen((odometry.t_s >= from_s) & (odometry.t_s <= until_s))
    barometer = recording.barometer
    barometer = barometer and barometer.chosen(
        (barometer.t_s >= from_s) & (barometer.t_s <= until_s)
    )
    t_s = motion_times_s(recording)
    if not any(each is not None and len(each.t_s) for each in (imu, odometry)):
        ran = "none" if t_s is None else f"that from {t_s[0]:.1f} to {t_s[-1]:.1f} s"
        raise InputError(
            f"{recording.name}: wanted motion from {from_s:g} to {until_s:g} s, got {ran}; choose "
            "a stretch in which the phone was carried"
        )
    return replace(
        recording,
        start_pose=recording.start_pose if from_s <= 0 else None,
        audio=recording.audio
        and _silenced(recording.audio, from_s, until_s, duration_s(recording)),
        imu=imu,
        odometry=odometry,
        barometer=barometer if barometer is not None and len(barometer.t_s) else None,
        crop_s=(from_s, until_s),
        motion_t_s=t_s,
    )


def _silenced(audio: Audio, from_s: float, until_s: float, ran_s: float | None) -> Audio:
    """The sound, silent outside the stretch, so that nothing there is judged.

    Sound that may lack samples, as it is not as long as the motion (`ran_s`), stays whole: its
    breaks tell when later chirps were heard.
    """
    length_s = audio.samples.shape[1] / audio.rate_hz
    if abs((ran_s or length_s) - length_s) > SLIGHT_S:
        return audio
    ends_s = np.clip([from_s, until_s], 0, length_s)
    first, last = np.round(ends_s * audio.rate_hz).astype(int)
    samples = np.zeros_like(audio.samples)
    samples[:, first:last] = audio.samples[:, first:last]
    return replace(audio, samples=samples)
