"""Strips of ELFs: one scale, a strip for each vector."""

from __future__ import annotations

import numpy as np

from studies.figures.elf_figures import strips_figure


def test_strips_share_one_scale_about_zero_and_keep_their_order() -> None:
    faint, strong = np.full((4, 8), 0.1), np.full((2, 8), -0.5)
    strong[1] = 0.25
    figure = strips_figure({"before": faint, "after": strong})
    first, second = figure.data
    assert first.zmin == second.zmin == -first.zmax == -0.5
    np.testing.assert_allclose(np.array(second.z), strong)
    assert list(second.y) == ["direction 1 ", "direction 2 "]
    assert [note.text for note in figure.layout.annotations] == ["<b>before</b>", "<b>after</b>"]
