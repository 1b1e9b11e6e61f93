"""WCAG 2.2 (A and AA) and good practice on a page, by axe-core in the browser."""

from functools import cache
from pathlib import Path
from typing import Any

import pytest

AXE = Path(__file__).parent / "javascript" / "node_modules" / "axe-core" / "axe.min.js"
ASKED = """async () => (await axe.run(document, { resultTypes: ["violations"] })).violations
  .flatMap(({ id, help, nodes }) => nodes.map((node) => `${id}: ${help}: ${node.html}`))"""


@cache
def axe_source() -> str:
    """The text of axe-core; skips the test where npm has not brought it."""
    if not AXE.is_file():
        pytest.skip("axe-core is missing: make lint-pages brings it")
    return AXE.read_text(encoding="utf-8")


def violations(page: Any) -> list[str]:
    """What of the page as it stands breaks a rule: the rule, what it means, and where."""
    if page.evaluate("typeof window.axe === 'undefined'"):
        page.evaluate(axe_source())
    return [str(each) for each in page.evaluate(ASKED)]
