"""The paper's table of mapping errors: echoes, their rivals, and all of them in one graph."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from elfslam.base.values import AnySimilarity, Odometry, Recording, Truth
from elfslam.learn.settings import ScratchParameters
from elfslam.line.closure import ClosureParameters
from elfslam.line.feature import Encoder, extract_features, load_encoder
from elfslam.line.graph import build_graph, optimise
from elfslam.line.motion import calibrated_by_distance
from elfslam.line.similarity import echo_sequence_similarity
from elfslam.score.bars import Bar, bars_figure
from elfslam.score.closure_score import score_closures
from elfslam.score.errors import Alignment, path_length_m, position_errors, summarise
from elfslam.score.page import Page, Panel, rows_table
from elfslam.senses import Modality, Settings, sense_of
from elfslam.slam import closures_of, hear, joined, walk_nodes
from elfslam.studies.finding import Announce, Finding, Row
from elfslam.studies.intervals import mean_row
from elfslam.studies.repeats import Numbers, finished
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world, simulate

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(10))
ROUNDS = 4
COURSE = "concourse"
"""Where a walker is calibrated: a lap of known length."""
OFF = 0.1
"""A walker who is not calibrated takes steps this much longer, or shorter, than assumed."""
CALIBRATED, UNCALIBRATED = "calibrated", "10 % off"
RIVALS = (Modality.WIFI, Modality.MAGNETIC, Modality.EMR)
ELF, SCRATCH, CURATED, FUSED = "ELF", "ELF without pre-training", "ELF, paper's curation", "all"
REACKONED = "dead reckoning"
SENSORS = (Sensor.WIFI, Sensor.MAGNETIC, Sensor.EMR)
PAPER: Mapping[str, Mapping[str, str]] = {
    ELF: {"living_room": "0.10 / 0.10 / 0.14", "office": "0.63 / 0.63 / 0.80", "mall": "0.45 / 0.53 / 0.69"},
    SCRATCH: {"living_room": "0.73 / 0.82 / 1.25", "office": "1.69 / 1.68 / 1.94", "mall": "1.16 / 1.14 / 1.42"},
    "wifi": {"living_room": "0.44 / 0.45 / 0.55", "office": "1.52 / 1.54 / 2.06", "mall": "1.24 / 1.26 / 1.54"},
    "magnetic": {"living_room": "0.56 / 0.55 / 0.64", "office": "1.14 / 1.24 / 1.82", "mall": "0.79 / 0.81 / 1.05"},
}  # fmt: skip
