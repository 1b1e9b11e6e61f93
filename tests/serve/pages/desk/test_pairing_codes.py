"""One more device: a code at the desk, pasted or opened elsewhere, and trust in the server."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tests.waiting import until

Open = Callable[..., Any]


def code_shown(page: Any) -> str:
    page.get_by_role("button", name="Pair a device").click()
    page.get_by_role("img", name="QR code of the address").wait_for()
    return str(page.get_by_role("textbox", name="Address").input_value())


def test_a_code_of_the_desk_pairs_another_browser_once(
    person: Any, open_desk: Open, browser: Any
) -> None:
    address = code_shown(open_desk(person))
    assert address.startswith(f"{person.origin}/#code=")
    other = browser.new_context()
    page = other.new_page()
    page.goto(address)
    until(lambda: "#" not in page.url or page.url.endswith("#"), "the code leaves the address")
    page.goto(f"{person.origin}/desk")
    page.get_by_text("Ada").wait_for(state="attached")
    other.close()
    late = browser.new_context()
    page = late.new_page()
    page.goto(address)
    page.get_by_text("was used or is too old").wait_for()
    assert "code=" not in page.url
    late.close()


def test_the_phone_page_takes_what_is_pasted(person: Any, open_desk: Open, browser: Any) -> None:
    address = code_shown(open_desk(person))
    context = browser.new_context(viewport={"width": 390, "height": 844})
    page = context.new_page()
    page.goto(f"{person.origin}/")
    page.get_by_label("Or paste the address here").fill(address)
    with page.expect_navigation():  # the page reloads, paired
        page.get_by_role("button", name="Pair", exact=True).click()
    page.locator("#problem").wait_for(state="hidden")
    page.goto(f"{person.origin}/desk")
    page.get_by_text("Ada").wait_for(state="attached")
    context.close()


@pytest.mark.parametrize("width", [320, 1024])
def test_the_page_of_trust_fits_and_says_where_there_is_nothing_to_trust(
    person: Any, browser: Any, width: int
) -> None:
    context = browser.new_context(viewport={"width": width, "height": 700})
    page = context.new_page()
    page.goto(f"{person.origin}/trust")
    page.get_by_text("speaks plain HTTP").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    context.close()
