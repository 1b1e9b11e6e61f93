"""Construction of the pose graph, and an initial guess of its poses by chordal relaxation."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from elfslam.base.arrays import C128, F64, I64, Bool
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, shifted
from elfslam.base.parameters import parameter
from elfslam.base.values import Closures, Odometry, PoseGraph

LEAST_SIGMA = 1e-9


@dataclass(frozen=True)
class GraphParameters:
    """How the graph is solved, and which closures it believes."""

    robust: bool = parameter(True, "", "reject closures that the rest contradicts")
    inlier_probability: float = parameter(
        0.99, "", "closures with a residual beyond this quantile are outliers", 0.5, 0.9999
    )
    agreeing_probability: float = parameter(
        0.9, "", "closures of a later modality beyond this quantile are left out", 0.1, 1.0
    )
    run_reach: int = parameter(
        10, "footsteps", "closures this near each other may belong to one run", 1, 1_000
    )
    run_closures: int = parameter(
        3, "", "fewest closures in a row that are believed for each other's sake", 2, 1_000
    )
    least_odds: float = parameter(
        1000.0,
        "",
        "how much likelier than chance a closure must fit to be believed alone",
        1.0,
        1e9,
    )
    noise_rounds: int = parameter(
        3, "", "how often the noise of steps is told anew by closures; 0: as stated", 0, 20
    )
    noise_prior: float = parameter(
        20.0, "", "redundant measurements that the stated noise of steps counts for", 0.0, 1e6
    )
    least_step_noise: float = parameter(
        0.25, "", "steps are held for no surer than by this share of their sigmas", 0.01, 1.0
    )
    anchor_sigma: float = parameter(1e-3, "m, rad", "sigma of the start pose", 1e-6, 10.0)
    iterations: int = parameter(100, "", "most iterations of the solver", 1, 10_000)


def build_graph(nodes: Odometry, closures: Closures) -> PoseGraph:
    """The pose graph of a walk: a node per footstep, an edge per step and an edge per closure.

    Raises InputError where a step claims to have no error: nothing could correct it.
    """
    if (nodes.step_sigma < LEAST_SIGMA).any():
        raise InputError(
            f"odometry: wanted sigmas of at least {LEAST_SIGMA:g}, got {nodes.step_sigma.min():g}; "
            "state how far each move can be off"
        )
    poses = nodes.world_from_body
    count = len(poses) - 1
    steps = np.column_stack([np.arange(count), np.arange(1, count + 1)])
    step_information = np.stack([np.diag(1 / sigma**2) for sigma in nodes.step_sigma])
    closing = closure_edges(poses, closures)
    drift_turn_rad = nodes.heading_drift_sigma_radps * np.diff(nodes.t_s)
    still = np.zeros(len(closures.i))
    drifts = nodes.heading_drift_sigma_radps > 0
    return PoseGraph(
        initial=poses,
        edges=np.vstack([steps, closing.edges]),
        measurements=np.vstack([between(poses[:-1], poses[1:]), closing.measurements]),
        information=np.concatenate([step_information, closing.information]),
        is_closure=np.arange(count + len(closures.i)) >= count,
        scale_sigma=nodes.scale_sigma,
        drift_turn_rad=np.concatenate([drift_turn_rad, still]) if drifts else None,
    )


def closure_edges(poses: F64, closures: Closures) -> PoseGraph:
    """The closures alone, as edges between poses (n, 3)."""
    information = np.asarray(np.linalg.inv(closures.covariance)).reshape(-1, 3, 3)
    edges = np.column_stack([closures.i, closures.j])
    every = np.ones(len(edges), dtype=bool)
    return PoseGraph(poses, edges, closures.i_from_j, information, every)


def seen_from_start(graph: PoseGraph) -> PoseGraph:
    """The same graph in a frame whose origin is at its first pose: only there are levers short."""
    return replace(graph, initial=shifted(graph.initial, -graph.initial[0, :2]))


def edges_of(graph: PoseGraph, chosen: I64 | Bool) -> PoseGraph:
    """The graph with some of its edges only: indices or a mask."""
    return PoseGraph(
        graph.initial,
        graph.edges[chosen],
        graph.measurements[chosen],
        graph.information[chosen],
        graph.is_closure[chosen],
        graph.scale_sigma,
        None if graph.drift_turn_rad is None else graph.drift_turn_rad[chosen],
    )


def believing(graph: PoseGraph, kept: Bool) -> PoseGraph:
    """The graph with all of its steps and the closures of the mask (k)."""
    chosen = ~graph.is_closure
    chosen[graph.is_closure] = kept
    return edges_of(graph, chosen)


def covariance_of_edges(graph: PoseGraph) -> F64:
    """Covariances (e, 3, 3) of the edges' measurements."""
    return np.asarray(np.linalg.inv(graph.information)).reshape(-1, 3, 3)


def rotation_first(graph: PoseGraph) -> F64:
    """Chordal initialisation: poses (n, 3) from no guess but the first, headings, then positions.

    A heading is a complex number; without holding its length at 1 the headings that agree best
    with all measured turns are linear in them (Carlone et al., ICRA 2015, "Initialization
    techniques for 3D SLAM", chordal relaxation). Given the headings, so are the positions.
    """
    first_x, first_y, first_heading = graph.initial[0]
    forward, left, turn = graph.measurements.T
    turn_weight = graph.information[:, 2, 2]
    still = np.zeros(len(turn), dtype=np.complex128)
    heading = _agreeing(graph, np.exp(1j * turn), still, turn_weight, np.exp(1j * first_heading))
    heading = heading / np.abs(heading)
    move = heading[graph.edges[:, 0]] * (forward + 1j * left)
    move_weight = (graph.information[:, 0, 0] + graph.information[:, 1, 1]) / 2
    same = np.ones(len(turn), dtype=np.complex128)
    position = _agreeing(graph, same, move, move_weight, first_x + 1j * first_y)
    return np.column_stack([position.real, position.imag, np.angle(heading)])


def _agreeing(graph: PoseGraph, factor: C128, offset: C128, weight: F64, first: complex) -> C128:
    """Least squares: z (n) that begins with `first` and best obeys z[j] = factor z[i] + offset."""
    count, edge = len(graph.initial), np.arange(len(graph.edges))
    root = np.sqrt(weight)
    entries = np.concatenate([-root * factor, root + 0j])
    ends = (np.concatenate([edge, edge]), graph.edges.T.ravel())
    matrix = csc_array((entries, ends), shape=(len(edge), count))
    free, known = matrix[:, 1:], matrix[:, [0]].toarray()[:, 0] * first
    adjoint = free.conj().T
    normal = csc_array(adjoint @ free)
    # Positive definite: nothing need be pivoted.
    options = {"SymmetricMode": True}
    factor_of = splu(normal, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.concatenate([[first], factor_of.solve(adjoint @ (root * offset - known))])
