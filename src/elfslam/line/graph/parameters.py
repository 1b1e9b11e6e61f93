"""What can be set in the back end."""

from __future__ import annotations

from dataclasses import dataclass

from elfslam.base.parameters import parameter


@dataclass(frozen=True)
class GraphParameters:
    """How the graph is solved, and which closures it believes."""

    robust: bool = parameter(True, "", "reject closures that the rest contradicts")
    inlier_probability: float = parameter(
        0.99, "", "closures with a residual beyond this quantile are outliers", low=0.5, high=0.9999
    )
    agreeing_probability: float = parameter(
        0.9, "", "closures of a further sense beyond this quantile are left out", low=0.1, high=1.0
    )
    run_reach: int = parameter(
        10, "footsteps", "closures this near each other may belong to one run", low=1, high=1_000
    )
    run_closures: int = parameter(
        3, "", "fewest closures in a row that are believed for each other's sake", low=2, high=1_000
    )
    least_odds: float = parameter(
        1000.0,
        "",
        "how much likelier than chance a closure must fit to be believed alone",
        low=1.0,
        high=1e9,
    )
    noise_rounds: int = parameter(
        3, "", "how often the noise of steps is told anew by closures; 0: as stated", low=0, high=20
    )
    noise_prior: float = parameter(
        20.0,
        "",
        "redundant measurements that the stated noise of steps counts for",
        low=0.0,
        high=1e6,
    )
    least_step_noise: float = parameter(
        0.25,
        "",
        "steps are held for no surer than by this share of their sigmas",
        low=0.01,
        high=1.0,
    )
    anchor_sigma: float = parameter(1e-3, "m, rad", "sigma of the start pose", low=1e-6, high=10.0)
    iterations: int = parameter(100, "", "most iterations of the solver", low=1, high=10_000)
