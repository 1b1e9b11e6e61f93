"""Every status that a fix can have has a word, a colour and a mark wherever fixes are shown."""

from __future__ import annotations

from importlib import resources

import pytest

from elfslam.base.values import FixStatus
from elfslam.scoring.figures import STATUSES

VIEWER = resources.files("elfslam").joinpath("serve/pages/desk/viewer")


@pytest.mark.parametrize("status", FixStatus)
def test_a_status_is_known_to_the_pages(status: FixStatus) -> None:
    assert f'  {status.name}: t("' in VIEWER.joinpath("scene.js").read_text(encoding="utf-8")
    assert f'{status.name}: colour("' in VIEWER.joinpath("scene.js").read_text(encoding="utf-8")


def test_figures_draw_every_status_otherwise() -> None:
    assert set(STATUSES) == set(FixStatus)
    assert len(set(STATUSES.values())) == len(FixStatus)
