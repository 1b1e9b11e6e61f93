"""URLs as people and logs see them: every secret hidden, all else as it was."""

import pytest

from elfslam.base.urls import has_secret, shown_url, without_secrets


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("postgresql://me:hunter2@h/d", "postgresql://me:***@h/d"),
        ("postgresql://me:a@hunter2@h/d", "postgresql://me:***@h/d"),
        ("postgresql://me:a/hunter2@h/d", "postgresql://me:***@h/d"),
        ("postgresql://me:a?hunter2@h/d", "postgresql://***?***"),
        ("postgresql://me:hunter2/d", "postgresql://***/d"),
        ("postgresql://h/d?user=me&password=hunter2", "postgresql://h/d?user=***&password=***"),
        ("postgresql://h/d?host=/tmp&sslpassword=hunter2",
         "postgresql://h/d?host=/tmp&sslpassword=***"),
        ("s3://KEY:hunter2@bucket/p", "s3://KEY:***@bucket/p"),
        ("simplecache::s3://KEY:hunter2@bucket/p", "simplecache::s3://KEY:***@bucket/p"),
        ("ray://me:hunter2@h:10001", "ray://me:***@h:10001"),
        ("mqtts://me:hunter2@h/x#hunter2", "mqtts://me:***@h/x#***"),
        ("me:hunter2@h", "of 12 characters (no URL)"),
        ("postgresql//me:hunter2@h/d", "of 26 characters (no URL)"),
        (f"mqtt://{'hunter2' * 6}@h/x", "mqtt://***@h/x"),
    ],
)  # fmt: skip
def test_what_is_secret_is_hidden(url: str, shown: str) -> None:
    assert shown_url(url) == shown
    assert has_secret(url)
    assert shown_url(shown).count("hunter2") == 0


@pytest.mark.parametrize(
    "url",
    ["sqlite:////srv/me@work/x.sqlite", "file:///srv/published", "memory://x", "/srv/me@work",
     "postgresql+psycopg://elfslam@/d?host=/tmp/pg", "postgresql://[::1]:5432/d",
     "postgresql://a:1,b:2/d", "ray://h:10001", "s3://bucket/prefix", "nonsense"],
)  # fmt: skip
def test_what_holds_no_secret_stays(url: str) -> None:
    assert shown_url(url) == url
    assert not has_secret(url)


def test_what_a_driver_says_repeats_no_secret() -> None:
    url = "postgresql://me:hunter2%40@h/d?sslpassword=swordfish"
    said = f"no {url}, hunter2%40, hunter2@ nor swordfish of me"
    told = without_secrets(said, url)
    assert told == f"no {shown_url(url)}, ***, *** nor *** of me"
