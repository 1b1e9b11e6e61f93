"""URLs as they are shown to people and to logs: without what is secret in them."""

import re
from urllib.parse import unquote

HIDDEN = "***"
SCHEME = re.compile(r"[a-z][a-z0-9+.-]*", re.IGNORECASE)
USER = re.compile(r"[\w.-]{1,32}")
"""What is longer is a token."""
PLACE = re.compile(r"(?:[\w.,-]|\[[0-9a-f:.]+\]|:\d{1,5}(?=,|$))*", re.IGNORECASE)
"""Hosts with their ports: what else stands there may be half of a password."""
CHAINED = re.compile(r"::(?=[a-z][a-z0-9+.-]*:/?/?)", re.IGNORECASE)
"""Between the links of a chain, as fsspec has them."""
WORD, LEAST_SECRET = re.compile(r"[:/?#@&=]"), 3
PLAIN_QUERY = {"host", "port", "dbname", "sslmode", "service", "connect_timeout", "mode"}
"""What else a query holds may be secret."""


def shown_url(url: str) -> str:
    """A URL, or a path, without its password and whatever else may be secret."""
    return "::".join(_shown_link(link) for link in CHAINED.split(url))


def has_secret(url: str) -> bool:
    """Whether `shown_url` hides something."""
    return shown_url(url) != url


def without_secrets(text: str, url: str) -> str:
    """What somebody says of a URL, who may repeat it or parts of it."""
    shown = shown_url(url)
    for part in (url, unquote(url)):
        text = text.replace(part, shown)
    words = {each for part in WORD.split(url) for each in (part, unquote(part))}
    for word in sorted(words, key=len, reverse=True):
        if len(word) >= LEAST_SECRET and word not in shown:
            text = text.replace(word, HIDDEN)
    return text


def _shown_link(url: str) -> str:
    scheme, found, rest = url.partition("://")
    if not found and (url.startswith(("/", ".", "~")) or not set(url) & set("@?=:")):
        return url
    if not (found and SCHEME.fullmatch(scheme)):
        return f"of {len(url)} characters (no URL)"
    before, question, query = rest.partition("?")
    before, number, fragment = before.partition("#")
    told = f"{scheme}://{_shown_place(before)}"
    if question:
        told += "?" + "&".join(_shown_pair(pair) for pair in query.split("&"))
    return told + (number and f"#{HIDDEN}" if fragment else number)


def _shown_place(text: str) -> str:
    """Host, port and path; a path alone may hold an @."""
    if text.startswith("/"):
        return text
    told, at, rest = text.rpartition("@")
    user, colon, _ = told.partition(":")
    place, slash, path = rest.partition("/")
    who = (user if USER.fullmatch(user) else HIDDEN) + (colon and f":{HIDDEN}")
    return f"{who}@" * bool(at) + (place if PLACE.fullmatch(place) else HIDDEN) + slash + path


def _shown_pair(pair: str) -> str:
    name, equals, value = pair.partition("=")
    if not equals:
        return HIDDEN
    return pair if name in PLAIN_QUERY and "@" not in value else f"{name}={HIDDEN}"
