"""Lost or exchanged credentials are refused before anything is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.base.errors import StoreError
from elfslam.serve.network.credentials import (
    OWNER_TOKEN,
    check_credentials,
    owner_token,
    trust_key,
)
from elfslam.serve.network.signing import SIGNING_KEY, fingerprint, signing_key
from elfslam.serve.services import Services


@pytest.fixture
def authority(services: Services) -> Path:
    """The folder of a store that was served once."""
    owner_token(services)
    trust_key(services)
    return services.settings.authority_folder


def check(services: Services, *, renews_token: bool = False, renews_key: bool = False) -> None:
    folder = services.settings.authority_folder
    check_credentials(services.engine, folder, renews_token=renews_token, renews_key=renews_key)


def test_a_new_store_has_nothing_to_lose(services: Services) -> None:
    check(services)
    assert list(services.settings.authority_folder.iterdir()) == []


def test_what_belongs_together_passes(services: Services, authority: Path) -> None:
    before = {file.name: file.read_bytes() for file in authority.iterdir()}
    check(services)
    assert owner_token(services) == (authority / OWNER_TOKEN).read_text().strip()
    assert (authority / OWNER_TOKEN).stat().st_mode & 0o077 == 0
    trust_key(services)
    assert {file.name: file.read_bytes() for file in authority.iterdir()} == before


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "is missing"), ("another\n", "is another one"), ("two words", "is damaged"),
     ("\xff\x00", "is damaged"), ("", "is damaged")],
)  # fmt: skip
def test_a_token_that_is_not_the_owners(
    services: Services, authority: Path, content: str | None, words: str
) -> None:
    file = authority / OWNER_TOKEN
    file.unlink()
    if content is not None:
        file.write_bytes(content.encode("latin-1"))
    with pytest.raises(StoreError, match=words) as said:
        check(services)
    assert "--new-token" in str(said.value)


def test_a_new_token_is_asked_for(services: Services, authority: Path) -> None:
    before = owner_token(services)
    (authority / OWNER_TOKEN).unlink()
    check(services, renews_token=True)
    assert owner_token(services, renewed=True) != before
    check(services)


def test_a_signing_key_that_phones_do_not_trust(services: Services, authority: Path) -> None:
    trusted = fingerprint(signing_key(authority))
    (authority / SIGNING_KEY).unlink()
    with pytest.raises(StoreError, match="is missing, and paired phones trust"):
        check(services)
    assert not (authority / SIGNING_KEY).exists()
    assert fingerprint(signing_key(authority)) != trusted
    with pytest.raises(StoreError, match=r"is another one, .* --new-key"):
        check(services)


def test_a_new_signing_key_is_asked_for(services: Services, authority: Path) -> None:
    before = fingerprint(signing_key(authority))
    check(services, renews_key=True)
    trust_key(services, renewed=True)
    assert fingerprint(signing_key(authority)) != before
    check(services)


def test_a_damaged_signing_key(services: Services, authority: Path) -> None:
    (authority / SIGNING_KEY).write_bytes(b"nonsense")
    with pytest.raises(StoreError, match="is no key"):
        check(services)
