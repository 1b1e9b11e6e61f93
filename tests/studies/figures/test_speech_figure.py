"""The figure of what is understood."""

from __future__ import annotations

import numpy as np

from studies.figures.speech_figure import CHANCE, speech_figure


def test_every_utterance_is_a_dot_and_every_series_has_its_mean() -> None:
    understood = {
        "before": np.array([0.8, 0.9]),
        "as sent": np.array([0.1, 0.3]),
        "as sent, enhanced": np.array([0.2, 0.4]),
        "unrelated as sent": np.array([0.1, 0.2]),
    }
    figure = speech_figure({"soft": understood, "loud": understood})
    dots = [part for part in figure.data if part.name == "soft"]
    assert [list(part.x) for part in dots] == [[0.8, 0.9], [0.1, 0.3], [0.2, 0.4]]
    means = [part.x[0] for part in figure.data if part.name == ""]
    assert means == [0.85, 0.2, 0.3] * 2
    assert sum(part.name == CHANCE for part in figure.data) == 4
    assert [part.name for part in figure.data if part.showlegend] == ["soft", CHANCE, "loud"]
    assert list(figure.layout.yaxis.ticktext) == ["before ", "as sent ", "as sent, enhanced "]
