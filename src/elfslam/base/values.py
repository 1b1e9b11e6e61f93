"""The values that flow through the pipeline. Rows are time; fields end in their unit.

One clock: seconds since the recording began, on the audio sample clock. One plane: x, y in
metres and heading in radians counter-clockwise from x. A pose is (x, y, heading).
"""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from elfslam.base.arrays import F32, F64, I64, Bool, Value, array, summary
from elfslam.base.errors import InputError

if TYPE_CHECKING:
    from elfslam.base.building import FloorsVisited

ECHO_RATE_HZ = 44_100
ECHO_SAMPLES = 2352  # a 12x48 image needs 96 + 47 * 48 (53.3 ms at 44.1 kHz)
DISCARDED_SAMPLES = 485  # 10 ms of direct path, 1 ms of reflection off the holder's body
ELF_SIZE = 128

Announce = Callable[[str, float | None], None]
"""Hears what is being done, and the share done where it is known."""


def silent(what: str, share: float | None) -> None:
    """Announce nothing."""


class PointKind(StrEnum):
    """What is at a point of interest."""

    ROOM = "room"
    DOOR = "door"
    STAIRS = "stairs"
    LIFT = "lift"
    OTHER = "other"


@dataclass(frozen=True)
class PointOfInterest:
    """A place with a name, in the plane of its map."""

    name: str
    kind: PointKind
    x_m: float
    y_m: float


@dataclass(frozen=True, eq=False)
class Chirp(Value):
    """The excitation: what the loudspeaker plays once per period."""

    samples: F32 = array("n", dtype=np.float32)
    rate_hz: int
    period_s: float
    band_hz: F64 = array(2)


@dataclass(frozen=True, eq=False)
class Audio(Value):
    """Recorded sound in [-1, 1], a row per channel; frames that are timed lack no samples."""

    samples: F32 = array("c", "n", dtype=np.float32, least=1)
    rate_hz: int
    is_timed: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Imu(Value):
    """Accelerometer (gravity included) and gyroscope on one clock, in phone axes."""

    t_s: F64 = array("n", increasing=True)
    accel_mps2: F64 = array("n", 3)
    gyro_radps: F64 = array("n", 3)


@dataclass(frozen=True, eq=False)
class Magnetometer(Value):
    """The magnetic field in phone axes, microtesla."""

    t_s: F64 = array("n", increasing=True)
    field_ut: F64 = array("n", 3)


@dataclass(frozen=True, eq=False)
class Barometer(Value):
    """Air pressure at the phone, hectopascal: it falls by one in 8.3 m, a floor or two."""

    t_s: F64 = array("n", increasing=True)
    pressure_hpa: F64 = array("n")


class LevelPassage(StrEnum):
    """What leads from one floor to another."""

    STAIRS = "stairs"
    LIFT = "lift"
    ESCALATOR = "escalator"


@dataclass(frozen=True, eq=False)
class Levels(Value):
    """On which floor somebody was: from each time (k) until the next, the last for good.

    `level` is the ordinal of the floor, 0 at the entrance, and NaN between floors; there
    `passages` says what they took, None where nobody knows and on a floor.
    """

    t_s: F64 = array("k", increasing=True)
    level: F64 = array("k", finite=False)
    passages: tuple[LevelPassage | None, ...]

    def at(self, t_s: F64) -> F64:
        """The level at each time (n); before the first row as there."""
        row = np.searchsorted(self.t_s, t_s, side="right") - 1
        return np.asarray(self.level[np.maximum(row, 0)])


@dataclass(frozen=True, eq=False)
class WifiScans(Value):
    """Received signal strength per scan and access point; NaN where unseen."""

    t_s: F64 = array("k", increasing=True)
    bssids: tuple[str, ...]
    rssi_dbm: F64 = array("k", "m", finite=False)
    age_s: F64 = array("k", "m", finite=False)


@dataclass(frozen=True, eq=False)
class Orientation(Value):
    """Attitude of the phone as quaternions x y z w."""

    t_s: F64 = array("n", increasing=True)
    world_from_phone: F64 = array("n", 4, unit_rows=True)


@dataclass(frozen=True, eq=False)
class Emr(Value):
    """Amplitude of the mains harmonics."""

    t_s: F64 = array("n", increasing=True)
    amplitude: F64 = array("n", "h")


@dataclass(frozen=True, eq=False)
class Checkpoints(Value):
    """When the walker said where they were: one name is one place, `xy_m` on the plan (or NaN)."""

    t_s: F64 = array("k", increasing=True)
    names: tuple[str, ...]
    xy_m: F64 | None = array("k", 2, finite=False, optional=True)


@dataclass(frozen=True, eq=False)
class Odometry(Value):
    """Dead reckoning: a pose per node (footstep) and the sigma of each move.

    `step_sigma` is (forward m, lateral m, heading rad) in the body frame of the earlier node,
    independent from move to move. What is wrong alike all along the walk comes on top, 0 where
    nobody says: `scale_sigma` of all lengths (relative), and a steady turn.
    """

    t_s: F64 = array("n", increasing=True)
    world_from_body: F64 = array("n", 3)
    step_sigma: F64 = array("n-1", 3)
    scale_sigma: float = 0.0
    heading_drift_sigma_radps: float = 0.0

    def chosen(self, rows: Bool | I64 | slice) -> Odometry:
        """Some nodes that follow each other."""
        kept = np.arange(len(self.t_s))[rows]
        poses, sigma = self.world_from_body[kept], self.step_sigma[kept[:-1]]
        return replace(self, t_s=self.t_s[kept], world_from_body=poses, step_sigma=sigma)


@dataclass(frozen=True, eq=False)
class Recording:
    """Everything a phone brought home from one walk; never the truth.

    `played_t_s` (n): when chirps began to be played, up to the way of the sound; `gain_db` (n): how
    loud; else once per period and alike. `crop_s` is the stretch that it was cropped to and
    `motion_t_s` (k) when motion was measured in the whole; `notes` say what was not right.
    """

    name: str
    device: str
    start_pose: tuple[float, float, float] | None = None
    audio: Audio | None = None
    imu: Imu | None = None
    orientation: Orientation | None = None
    odometry: Odometry | None = None
    magnetometer: Magnetometer | None = None
    barometer: Barometer | None = None
    wifi: WifiScans | None = None
    emr: Emr | None = None
    played_t_s: F64 | None = None
    gain_db: F64 | None = None
    crop_s: tuple[float, float] | None = None
    motion_t_s: F64 | None = None
    checkpoints: Checkpoints | None = None
    notes: tuple[str, ...] = ()

    __repr__ = summary


@dataclass(frozen=True, eq=False)
class Truth(Value):
    """Where the walker really was, for scoring and studies alone; heading NaN at waypoints."""

    t_s: F64 = array("n", increasing=True)
    world_from_body: F64 = array("n", 3, finite=False)
    levels: Levels | None = None


@dataclass(frozen=True, eq=False)
class Echoes(Value):
    """Aligned echo traces; sample 0 lies 485 samples after the direct arrival.

    `losses_s` lists the breaks of the stream: (when, how many seconds were lost); 0 s where the
    offset between playing and recording changed and no sound was lost. `over_noise_db` is how far
    a typical echo stands over the noise of one compressed chirp, NaN where nobody measured it.
    """

    t_s: F64 = array("n", increasing=True)
    samples: F32 = array("n", ECHO_SAMPLES, dtype=np.float32)
    losses_s: F64 = array("k", 2)
    rate_hz: int = ECHO_RATE_HZ
    over_noise_db: float = float("nan")


@dataclass(frozen=True, eq=False)
class FrameFacts(Value):
    """What was heard around every chirp that was due, heard or not.

    `t_due_s` is when its direct sound was due and `late_s` how much later it came, NaN where it
    did not. Of the envelope of the matched filter: `level` of the direct sound, `before` the
    largest in the quiet stretch before it over `level`, `noise` the typical there. `clipped` is the
    share of its samples at full scale, `gain_db` how loud it was played up to a constant, if known.
    """

    t_due_s: F64 = array("n")
    late_s: F64 = array("n", finite=False)
    level: F64 = array("n")
    before: F64 = array("n")
    noise: F64 = array("n")
    clipped: F64 = array("n")
    gain_db: F64 | None = array("n", optional=True)


@dataclass(frozen=True, eq=False)
class EchoPairs(Value):
    """Training material: two echo traces per place, the room and position of the first."""

    first: F32 = array("n", ECHO_SAMPLES, dtype=np.float32)
    second: F32 = array("n", ECHO_SAMPLES, dtype=np.float32)
    room: I64 = array("n", dtype=np.int64)
    xy_m: F64 = array("n", 2)


@dataclass(frozen=True, eq=False)
class Features(Value):
    """A unit vector per echo, and the identity of the encoder that made them.

    `attenuation` is what noise leaves of the mean of many, as a share of that without noise.
    """

    t_s: F64 = array("n", increasing=True)
    vectors: F32 = array("n", "d", dtype=np.float32, unit_rows=True)
    encoder: str
    attenuation: float = 1.0

    def means_between(self, edges_s: F64, fewest: int = 1) -> F32:
        """Mean features (n-1, d) between consecutive times (n); NaN where echoes are fewer."""
        stretch = np.searchsorted(edges_s, self.t_s, side="right") - 1
        inside = (stretch >= 0) & (stretch < len(edges_s) - 1)
        sums = np.zeros((len(edges_s) - 1, self.vectors.shape[1]))
        np.add.at(sums, stretch[inside], self.vectors[inside])
        counts = np.bincount(stretch[inside], minlength=len(sums))
        means = sums / np.where(counts >= fewest, counts, np.nan)[:, None]
        return np.asarray(means, np.float32)


@dataclass(frozen=True, eq=False)
class Similarity(Value):
    """Scores between nodes; node k is the stretch from footstep k to k+1."""

    scores: F32 = array("n", "n", dtype=np.float32)
    kind: str

    @property
    def count(self) -> int:
        """How many nodes there are."""
        return len(self.scores)

    def rows(self, first: int, last: int) -> F32:
        """Scores (last - first, n) of nodes `first` to `last`, without the last."""
        return self.scores[first:last]


@dataclass(frozen=True, eq=False)
class MeanSimilarity(Value):
    """Scores as dot products of a mean feature per node, made where asked for: hours have many."""

    means: F32 = array("n", "d", dtype=np.float32)
    kind: str

    @property
    def count(self) -> int:
        """How many nodes there are."""
        return len(self.means)

    @property
    def scores(self) -> F32:
        """All of them (n, n); for walks that are not long."""
        return self.rows(0, self.count)

    def rows(self, first: int, last: int) -> F32:
        """Scores (last - first, n) of nodes `first` to `last`, without the last."""
        return np.asarray(self.means[first:last] @ self.means.T)


AnySimilarity = Similarity | MeanSimilarity


@dataclass(frozen=True, eq=False)
class Closures(Value):
    """Pairs of nodes at the same place, i < j, with their relative pose and its covariance."""

    i: I64 = array("k", dtype=np.int64)
    j: I64 = array("k", dtype=np.int64)
    score: F64 = array("k")
    i_from_j: F64 = array("k", 3)
    covariance: F64 = array("k", 3, 3, covariance=True)


NO_CLOSURES = Closures(
    np.empty(0, int), np.empty(0, int), np.empty(0), np.empty((0, 3)), np.empty((0, 3, 3))
)


@dataclass(frozen=True, eq=False)
class PoseGraph(Value):
    """Initial poses and the edges between them: measured i_from_j with its information.

    `scale_sigma` is the error of all lengths together, which no edge can see. `drift_turn_rad` is
    by how much a heading that drifts steadily turns each edge, if it drifts by one sigma.
    """

    initial: F64 = array("n", 3)
    edges: I64 = array("e", 2, dtype=np.int64)
    measurements: F64 = array("e", 3)
    information: F64 = array("e", 3, 3, largest=np.inf)
    is_closure: Bool = array("e", dtype=np.bool_)
    scale_sigma: float = 0.0
    drift_turn_rad: F64 | None = array("e", optional=True)


@dataclass(frozen=True)
class Verdict:
    """Chi-square test of closures: how many were believed or rejected, and how many of each agree.

    To agree is to have a residual inside the quantile `probability`: nearly that share of believed
    ones do, if all is well, and hardly any of the rejected.
    """

    believed: int
    believed_agreeing: int
    rejected: int
    rejected_agreeing: int
    probability: float

    def __str__(self) -> str:
        return (
            f"{self.believed_agreeing} of {self.believed} believed closures and "
            f"{self.rejected_agreeing} of {self.rejected} rejected ones agree with the trajectory "
            f"(within {self.probability:.0%} of chance)"
        )


@dataclass(frozen=True, eq=False)
class Trajectory(Value):
    """The corrected walk: a pose and a covariance per footstep.

    `closure_weights` says how far the back end trusted each closure (0 rejected, 1 kept).
    `status` is OK, or NO_CLOSURES where nothing corrected the dead reckoning. The `verdict` comes
    with the optimisation alone: no file holds it.
    """

    t_s: F64 = array("n", increasing=True)
    world_from_body: F64 = array("n", 3)
    covariance: F64 = array("n", 3, 3, covariance=True)
    closure_weights: F64 = array("k")
    status: str
    verdict: Verdict | None = None


class Plotted:
    """A value that `elfslam.plot` can draw."""

    def plot(self, truth: Any = None, **besides: Any) -> Any:
        """A Plotly figure of this; see `elfslam.plot`."""
        import elfslam

        return elfslam.plot(self, truth, **besides)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Payload(Value):
    """What one modality knows at each spot of a map, and the encoder that made it."""

    kind: str
    encoder: str
    vectors: F32 = array("m", "d", dtype=np.float32)


@dataclass(frozen=True, eq=False)
class FloorMap(Value, Plotted):
    """Spots with positions, and one payload per modality.

    `weight` says how much what is known of a spot still counts (1 where nobody says), `changed`
    whether its surroundings have changed since.
    """

    xy_m: F64 = array("m", 2)
    heading_rad: F64 = array("m")
    walk: I64 = array("m", dtype=np.int64)
    order: I64 = array("m", dtype=np.int64)
    covariance_m2: F64 = array("m", 2, 2, covariance=True)
    payloads: tuple[Payload, ...]
    parameters_digest: str
    sources: tuple[str, ...]
    weight: F64 = array("m", optional=True)
    changed: Bool = array("m", dtype=np.bool_, optional=True)

    def __post_init__(self) -> None:
        for name, usual in (("weight", np.ones), ("changed", np.zeros)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, usual(len(self.xy_m)))
        super().__post_init__()
        for payload in self.payloads:
            if (rows := len(payload.vectors)) != (spots := len(self.xy_m)):
                raise InputError(
                    f"FloorMap.payloads: {payload.kind} has {rows} rows, wanted one for each of "
                    f"{spots} spots; make the map again"
                )


class FixStatus(IntEnum):
    """What a fix is worth."""

    OK = 0
    AMBIGUOUS = 1
    UNKNOWN_PLACE = 2
    NO_ECHO = 3
    SUSPECT = 4


@dataclass(frozen=True, eq=False)
class Fixes(Value, Plotted):
    """Positions in a map; NaN where the status says that there is none.

    `t_s` is the middle of the echoes used; `status` holds `FixStatus` values. In a building each
    has its `level`, NaN where nobody can say.
    """

    t_s: F64 = array("n", increasing=True)
    xy_m: F64 = array("n", 2, finite=False)
    heading_rad: F64 = array("n", finite=False)
    covariance_m2: F64 = array("n", 2, 2, finite=False, covariance=True)
    score: F64 = array("n", finite=False)
    status: I64 = array("n", dtype=np.int64)
    level: F64 | None = array("n", finite=False, optional=True)


@dataclass(frozen=True, eq=False)
class Run(Plotted):
    """What mapping one recording gives, with its evidence.

    `compass_sigma_rad` is how sure the compass is that the walk is headed by, where one is.
    `visited` are the floors of a walk over several; such has no map of its own, its floors have.
    """

    name: str
    odometry: Odometry
    similarity: AnySimilarity
    closures: Closures
    trajectory: Trajectory
    floor_map: FloorMap | None
    echoes: Echoes | None
    features: Features | None
    seconds: dict[str, float] = field(default_factory=dict)
    points_of_interest: tuple[PointOfInterest, ...] = ()
    checkpoints: Checkpoints | None = None
    compass_sigma_rad: float | None = None
    visited: FloorsVisited | None = None

    def __repr__(self) -> str:
        """What mapping gave, in a line."""
        kept = int((self.trajectory.closure_weights > 0.5).sum())
        return (
            f"Run({self.name!r}, by {self.similarity.kind}: {len(self.trajectory.t_s)} footsteps, "
            f"{kept} of {len(self.closures.i)} closures kept, {self.trajectory.status})"
        )
