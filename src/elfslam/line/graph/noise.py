"""How noisy the steps of a walk were, as its own loops tell.

Steps of a careful walker err less than is said of steps in general. What closures left over of each
step says by how much: an estimate of variance components (Helmert 1907), with the redundancy of
each measurement after Förstner (1979, "Ein Verfahren zur Schätzung von Varianz- und
Kovarianzkomponenten").
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import PoseGraph
from elfslam.line.graph.blocks import pattern_of
from elfslam.line.graph.build import edges_of
from elfslam.line.graph.linear import (
    equations_at,
    predicted_covariance,
    residuals,
    settle,
    uncertainty,
)
from elfslam.line.graph.parameters import GraphParameters

SETTLING_STEPS = 10


def with_own_noise(
    graph: PoseGraph, poses: F64, parameters: GraphParameters
) -> tuple[F64, PoseGraph]:
    """The poses (n, 3) that steps as noisy as the closures find them give, and how sure those are.

    One factor for the variances of all steps in each of forward, left and turn. Steps err alike
    too, by their scale: poses lean on none of them more than was stated, while the uncertainty of
    the graph that comes back is as told. `poses` solve the graph as it is. Both as they were where
    it has no closures.
    """
    if not (parameters.noise_rounds and graph.is_closure.any()):
        return poses, graph
    pattern = pattern_of(graph.edges, len(poses))
    told, factor, trial = graph, np.ones(3), poses
    for _ in range(parameters.noise_rounds):
        factor = factor * variance_factors(told, trial, parameters)
        factor = np.maximum(factor, parameters.least_step_noise**2)
        told = _with_step_variances(graph, factor)
        trial, _ = settle(told, trial, pattern, parameters.anchor_sigma, SETTLING_STEPS)
    leaning = _with_step_variances(graph, np.maximum(factor, 1.0))
    poses, _ = settle(leaning, poses, pattern, parameters.anchor_sigma, SETTLING_STEPS)
    return poses, told


def variance_factors(graph: PoseGraph, poses: F64, parameters: GraphParameters) -> F64:
    """How much larger (3) the variances of steps are than the graph says, by its solution.

    Squared whitened residuals against the redundancy that they have; `noise_prior` of both speak
    for the variances as stated.
    """
    pattern = pattern_of(graph.edges, len(poses))
    known = uncertainty(equations_at(graph, poses, pattern, parameters.anchor_sigma))
    steps = edges_of(graph, ~graph.is_closure)
    predicted = predicted_covariance(known, poses, steps.edges, steps.measurements)
    residual = residuals(poses, steps.edges, steps.measurements)
    squared = residual * np.einsum("eab,eb->ea", steps.information, residual)
    redundancy = 1 - np.einsum("eab,eba->ea", steps.information, predicted)
    prior = parameters.noise_prior
    return np.asarray((prior + squared.sum(axis=0)) / (prior + redundancy.sum(axis=0)))


def _with_step_variances(graph: PoseGraph, factor: F64) -> PoseGraph:
    """The variances of steps times a factor (3); what a step has beyond the usual stays."""
    steps = ~graph.is_closure
    stated = 1 / np.diagonal(graph.information[steps], axis1=1, axis2=2)
    usual = np.minimum(stated, np.median(stated, axis=0))
    shrink = np.sqrt(stated / (stated + (factor - 1) * usual))
    information = graph.information.copy()
    information[steps] *= shrink[:, :, None] * shrink[:, None, :]
    return replace(graph, information=information)
