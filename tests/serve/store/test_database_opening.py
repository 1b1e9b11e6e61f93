"""Databases that cannot be opened, said in one line without the password."""

from __future__ import annotations

import pytest

from elfslam.base.errors import InputError, StoreError
from elfslam.serve.store.database import open_database


@pytest.mark.parametrize(
    ("url", "error", "words"),
    [
        ("nonsense", InputError, "database nonsense"),
        ("postgresql//u:secret@host/x", InputError, "wanted such as"),
        ("postgresql+psycopg//u:secret@host/x", InputError, "wanted such as"),
        ("postgresql://u:secret@host:port/x", InputError, "wanted such as"),
        ("oracle9://x", InputError, "wanted such as"),
        ("sqlite:////nowhere/at/all.sqlite", StoreError, "cannot be read"),
        ("postgresql+psycopg://u:secret@/x?host=/nowhere", StoreError, "cannot be read"),
    ],
)
def test_a_database_that_is_none(url: str, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words) as refused:
        open_database(url)
    assert "secret" not in str(refused.value)
    assert "\n" not in str(refused.value)
