"""The phone page in another language: which, all of it, within narrow screens, and back."""

from typing import Any

import pytest

from tests.accessibility import violations
from tests.untranslated import clipped, left_in_english

pytestmark = pytest.mark.real
TITLE = {"en": "Walk, and get a map", "de": "Geh herum, und du hast eine Karte"}


@pytest.fixture
def locale() -> str:
    """German, as it is spoken in Switzerland: of German there is one catalogue."""
    return "de-CH"


def check_view(phone: Any) -> None:
    page = phone.page
    for width_px in (390, 320):
        page.set_viewport_size({"width": width_px, "height": 640})
        assert left_in_english(page, "de") == []
        assert clipped(page) == []
        assert violations(page) == []
        assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0


def choose(phone: Any, language: str) -> None:
    phone.page.select_option("#language", language)
    phone.wait_for_text("h1:visible", TITLE[language])
    assert phone.page.get_attribute("html", "lang") == language


def test_a_walk_in_german(phone: Any) -> None:
    page = phone.page
    phone.open()
    phone.move()
    phone.wait_for_text("h1:visible", TITLE["de"])
    assert page.get_attribute("html", "lang") == "de"
    page.click("text=Bevor du losgehst")
    check_view(phone)
    phone.allow()
    check_view(phone)
    page.click("#go-on")
    page.click("text=Start und Ton")
    assert page.input_value("#walk-name").startswith("Rundgang am ")
    check_view(phone)
    page.click("text=Losgehen")
    phone.wait_for_text("#network-said", "Verbunden")
    phone.walk(2)
    assert page.inner_text("#recording-badge") == "Aufnahme"
    check_view(phone)
    page.click("#stop")
    phone.wait_for_text("#finish-title", "Die Karte entsteht")
    check_view(phone)


def test_where_am_i_in_german(phone: Any) -> None:
    phone.open()
    phone.page.click("text=Wo bin ich?")
    phone.wait_for_text("#maps", "Es gibt noch keine Karte")
    check_view(phone)


def test_the_language_that_was_chosen_stays(phone: Any) -> None:
    phone.open()
    phone.wait_for_text("h1:visible", TITLE["de"])
    choose(phone, "en")
    phone.page.reload()
    phone.wait_for_text("h1:visible", TITLE["en"])
    assert phone.page.input_value("#language") == "en"
    assert "Where am I?" in left_in_english(phone.page, "de"), "English is noticed"
    choose(phone, "de")
    phone.page.reload()
    phone.wait_for_text("h1:visible", TITLE["de"])


def test_without_its_catalogue_the_page_speaks_english(phone: Any) -> None:
    phone.page.context.route("**/words/de.json", lambda route: route.abort())
    phone.open()
    phone.wait_for_text("h1:visible", TITLE["en"])
    assert phone.page.get_attribute("html", "lang") == "en"


def test_a_phone_without_a_network_keeps_its_language(phone: Any) -> None:
    phone.open()
    phone.wait_for(
        lambda: phone.page.get_attribute("html", "data-offline") == "kept", "the page is kept"
    )
    phone.page.reload()
    phone.page.context.set_offline(True)
    phone.page.reload()
    phone.wait_for_text("h1:visible", TITLE["de"])
    assert not left_in_english(phone.page, "de")
    choose(phone, "en")


@pytest.mark.parametrize(
    ("address", "title"),
    [("/trust", "Diesem Server vertrauen"), ("/no/such/page", "Diese Seite gibt es nicht")],
)
def test_pages_beside_the_walk_in_german(phone: Any, address: str, title: str) -> None:
    phone.open()
    page = phone.page
    page.evaluate("address => { location.href = new URL(address, location.origin).href; }", address)
    phone.wait_for_text("h1:visible", title)
    check_view(phone)
