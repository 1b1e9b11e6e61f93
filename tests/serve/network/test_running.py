"""A real server: HTTPS with its own authority, killed and started again, stopped in time."""

import hashlib
import random
import resource
import signal
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

from elfslam.base.errors import InputError, StoreError
from elfslam.serve.network import running
from elfslam.serve.network.addresses import checked_hosts
from elfslam.serve.network.authority import (
    SIGNING_KEY,
    fingerprint,
    fingerprint_of,
    open_authority,
    server_certificate,
    signing_key,
    utc_now,
)
from elfslam.serve.people.users import set_owner_token
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.opening import InUseError
from studies.benchmarks.served import PIECE
from tests.serve.uploading import append, offset_of, uploading
from tests.waiting import until

Start = Callable[..., Any]
ROUNDS = 2


@pytest.fixture(scope="module")
def server(start_server: Start) -> Any:
    """A server that several tests ask, as long as none of them ends it."""
    return start_server(silence_s=1.0)


@pytest.fixture(scope="module")
def secure(start_server: Start) -> Any:
    """The same, over TLS."""
    return start_server(speaks="https")


def test_https_with_the_authoritys_certificate(secure: Any) -> None:
    server = secure
    trusted = ssl.create_default_context(cafile=str(server.data / "authority" / "authority.pem"))
    with httpx.Client(base_url=server.url, verify=trusted, headers=server.bearer) as client:
        assert client.get("/api/me").json()["is_owner"] is True
        pem = client.get("/authority.pem")
        assert pem.content == (server.data / "authority" / "authority.pem").read_bytes()
        answer = client.post("/api/session")
        assert "; Secure" in answer.headers["set-cookie"]
        assert "server" not in answer.headers
    with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
        httpx.get(server.url)


def test_a_kill_loses_nothing_that_was_acknowledged(start_server: Start) -> None:
    generator = random.Random(7)
    data = generator.randbytes(4_000_000)
    server, place, acknowledged = start_server(), "", 0
    for pieces in [generator.randint(2, 15) for _ in range(ROUNDS)]:
        with httpx.Client(base_url=server.url, headers=server.bearer) as client:
            place = place or uploading(client, len(data), "audio.flac")
            acknowledged = resume(client, place, data, acknowledged, pieces)
            killer = threading.Timer(generator.uniform(0, 0.03), server.process.kill)
            killer.start()
            acknowledged = resume(client, place, data, acknowledged, len(data))
        assert acknowledged < len(data), "killed too late"
        killer.join()
        server.process.wait()
        server = start_server(server.data)
    with httpx.Client(base_url=server.url, headers=server.bearer) as client:
        assert resume(client, place, data, acknowledged, len(data)) == len(data)
    kept = (server.data / "uploads" / place.rpartition("/")[2]).read_bytes()
    assert hashlib.sha256(kept).digest() == hashlib.sha256(data).digest()


def resume(client: httpx.Client, place: str, data: bytes, acknowledged: int, pieces: int) -> int:
    """Send so many pieces, or until the server is gone; how much it acknowledged in all."""
    try:
        offset = offset_of(client, place)
        assert offset >= acknowledged
        for _ in range(pieces):
            if offset == len(data):
                break
            answer = append(client, place, offset, data[offset : offset + 40_000])
            assert answer.status_code == 204, answer.text
            offset = acknowledged = int(answer.headers["upload-offset"])
    except httpx.TransportError:
        pass
    return acknowledged


def test_a_piece_that_is_cut_off_is_kept_as_far_as_it_came(server: Any) -> None:
    with httpx.Client(base_url=server.url, headers=server.bearer) as client:
        place = uploading(client, 1_000_000, "audio.flac")
        with raw(server.url) as connection:
            connection.sendall(request(place, server.token, 900_000) + b"x" * 300_000)
            until(lambda: offset_of(client, place) == 300_000, "the piece")
            assert append(client, place, 300_000, b"y").status_code == 423
        until(lambda: append(client, place, 300_000, b"y").status_code == 204, "room")
        assert offset_of(client, place) == 300_001


def test_silence_ends_a_piece(server: Any) -> None:
    with httpx.Client(base_url=server.url, headers=server.bearer) as client:
        place = uploading(client, 1000, "audio.flac")
        with raw(server.url) as connection:
            connection.sendall(request(place, server.token, 900) + b"x" * 300)
            answer = connection.recv(4096)
        assert b" 408 " in answer
        assert b"application/problem+json" in answer
        assert offset_of(client, place) == 300


def test_silence_ends_any_request(server: Any) -> None:
    with raw(server.url) as connection:
        connection.sendall(
            b"POST /api/recordings HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100\r\n"
            b"Content-Type: application/json\r\n\r\n{"
        )
        assert b" 408 " in connection.recv(4096)


def test_a_stream_of_unknown_length_stops_at_what_was_said(server: Any) -> None:
    def pieces() -> Iterator[bytes]:
        yield b"x" * 1000
        time.sleep(0.2)
        yield b"more"

    with httpx.Client(base_url=server.url, headers=server.bearer) as client:
        place = uploading(client, 1000, "audio.flac")
        assert append(client, place, 0, pieces()).status_code == 413
        assert offset_of(client, place) == 1000


def test_two_gigabytes_that_are_claimed_are_refused_at_once(server: Any) -> None:
    for path in ("/api/recordings", "/api/uploads", "/nowhere"):
        with raw(server.url) as connection:
            head = f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {2 * 2**30}\r\n\r\n"
            connection.sendall(head.encode())
            assert b" 413 " in connection.recv(4096)


def test_a_stop_waits_for_the_piece_that_is_coming(start_server: Start) -> None:
    server = start_server()
    with httpx.Client(base_url=server.url, headers=server.bearer) as client:
        place = uploading(client, 1000, "audio.flac")
    with raw(server.url) as connection:
        connection.sendall(request(place, server.token, 1000) + b"x" * 400)
        time.sleep(0.3)
        server.process.send_signal(signal.SIGTERM)
        time.sleep(0.3)
        connection.sendall(b"x" * 600)
        assert b" 204 " in connection.recv(4096)
    server.process.wait(timeout=20)
    assert (server.data / "uploads" / place.rpartition("/")[2]).stat().st_size == 1000


def raw(url: str) -> socket.socket:
    parts = urlsplit(url)
    return socket.create_connection((str(parts.hostname), parts.port or 0), timeout=20)


def request(place: str, token: str, length: int, offset: int = 0) -> bytes:
    lines = [
        f"PATCH {place} HTTP/1.1",
        "Host: 127.0.0.1",
        f"Authorization: Bearer {token}",
        *(f"{name}: {value}" for name, value in PIECE.items()),
        f"Upload-Offset: {offset}",
        f"Content-Length: {length}",
    ]
    return ("\r\n".join(lines) + "\r\n\r\n").encode()


def test_the_greeting_shows_the_address_and_its_code(tmp_path: Path) -> None:
    own, pairing = "https://127.0.0.1:8443/", "https://10.0.0.7:8443/#token=abc&key=def"
    certificate = server_certificate(tmp_path, ["10.0.0.7"], utc_now())
    lines = running.greeting(["https://10.0.0.7:8443/", own], pairing, certificate)
    assert lines[0] == pairing
    assert len({len(line) for line in running.qr_lines(lines[0])}) == 1
    assert set(running.qr_lines(pairing)) <= set(lines)
    assert "https://10.0.0.7:8443/trust" in lines[-2]
    assert lines[-1] == fingerprint_of(tmp_path / "authority.pem")
    assert not any(own in line for line in lines)


def test_another_address_is_told_and_no_code_leads_a_phone_to_itself() -> None:
    urls = ["https://10.0.0.7:8443/", "https://192.168.1.7:8443/", "https://127.0.0.1:8443/"]
    told = "\n".join(running.greeting(urls, f"{urls[0]}#token=a", None))
    assert "https://192.168.1.7:8443/ (--address)" in told
    own = "https://127.0.0.1:8443/"
    first, why = running.greeting([own], f"{own}#token=a", None)
    assert first == f"{own}#token=a"
    assert why.startswith("No code to scan")


def test_plain_http_on_the_port_of_https_leads_there(secure: Any) -> None:
    server = secure
    parts = urlsplit(server.url)
    plain = f"http://127.0.0.1:{parts.port}/desk?a=b"
    answer = httpx.get(plain, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (
        307,
        f"https://127.0.0.1:{parts.port}/desk?a=b",
    )
    with raw(server.url) as connection:
        connection.sendall(b"no request at all\r\n\r\n")
        assert connection.recv(4096)[:4] != b"HTTP"
    trusted = ssl.create_default_context(cafile=str(server.data / "authority" / "authority.pem"))
    assert httpx.get(server.url + "trust", verify=trusted).status_code == 200


def test_an_invitation_is_an_address_with_a_token_and_the_key(settings: ServerSettings) -> None:
    name, url = running.invite(settings, " Zoë ")
    assert name == "Zoë"
    assert "#token=" in url
    assert url.endswith(f"&key={fingerprint(signing_key(settings.authority_folder))}")
    with pytest.raises(InputError, match="printable"):
        running.invite(settings, "a\nb")


def test_plain_http_stays_on_this_machine(settings: ServerSettings) -> None:
    with pytest.raises(InputError, match="this machine alone"):
        running.run(settings, running.Listening("10.1.2.3", 0, plain_http=True), print)


def test_public_addresses_want_a_word() -> None:
    for host in ("0.0.0.0", "8.8.8.8", "::"):
        with pytest.raises(InputError, match="or allow public ones"):
            checked_hosts(host, allow_public=False)
        assert checked_hosts(host, allow_public=True) == [host]
    assert checked_hosts(None, allow_public=False)[-1] == "127.0.0.1"


def test_a_second_server_is_refused_before_it_changes_anything(server: Any) -> None:
    assert httpx.get(server.url + "api/me", headers=server.bearer).is_success, "it has written all"
    before = contents(server.data / "authority")
    second = running.Listening("127.0.0.1", 0, plain_http=True, new_token=True, new_key=True)
    with pytest.raises(InUseError, match="another server is using it"):
        running.run(ServerSettings(server.data, run_jobs=False), second, print)
    assert contents(server.data / "authority") == before
    assert httpx.get(server.url + "api/me", headers=server.bearer).is_success


WRONG = {
    "owner.token": lambda file: file.write_text("another"),
    "signing.key": lambda file: file.write_text("nonsense"),
    "authority.key": lambda file: file.write_text("nonsense"),
    "server.pem": Path.mkdir,
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("is_new", [True, False])
def test_a_start_that_is_refused_writes_no_key(
    settings: ServerSettings, name: str, is_new: bool
) -> None:
    folder, listening = settings.authority_folder, running.Listening("127.0.0.1", 0)
    services = open_services(settings)
    if not is_new:
        running.owner_token(services)
        running.trust_key(services)
        open_authority(folder)
    else:
        set_owner_token(services, "the one in use")
    services.engine.dispose()
    (folder / name).unlink(missing_ok=True)
    WRONG[name](folder / name)
    before = contents(folder)
    with pytest.raises(StoreError):
        running.run(settings, listening, print)
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("url", "words"),
    [("gopher://bucket/p", "wanted such as s3://"), ("s3://me:hunter2@bucket", "a password")],
)
def test_files_of_an_unknown_kind_or_with_a_password(
    settings: ServerSettings, url: str, words: str
) -> None:
    wrong = replace(settings, files_url=url)
    with pytest.raises(InputError, match=words) as said:
        running.run(wrong, running.Listening("127.0.0.1", 0, plain_http=True), print)
    assert "hunter2" not in str(said.value)
    assert not settings.data_folder.exists()


def test_a_server_that_cannot_listen_changes_nothing(settings: ServerSettings) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port}: cannot listen there"):
            running.run(
                settings,
                running.Listening("127.0.0.1", port, plain_http=True, new_token=True),
                print,
            )
    assert list(settings.authority_folder.iterdir()) == []


@pytest.fixture
def authority(services: Services) -> Path:
    """The folder of a store that was served once."""
    running.owner_token(services)
    running.trust_key(services)
    return services.settings.authority_folder


def check(services: Services, **renews: bool) -> None:
    wanted = {"renews_token": False, "renews_key": False, **renews}
    running.check_credentials(services.engine, services.settings.authority_folder, **wanted)


def contents(folder: Path) -> dict[str, bytes | bool]:
    """Of the files of a folder."""
    return {file.name: file.is_file() and file.read_bytes() for file in folder.iterdir()}


def test_a_new_store_has_nothing_to_lose(services: Services) -> None:
    check(services)
    assert list(services.settings.authority_folder.iterdir()) == []


def test_what_belongs_together_passes(services: Services, authority: Path) -> None:
    before = contents(authority)
    check(services)
    assert running.owner_token(services) == (authority / running.OWNER_TOKEN).read_text().strip()
    assert (authority / running.OWNER_TOKEN).stat().st_mode & 0o077 == 0
    running.trust_key(services)
    assert contents(authority) == before


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "is missing"), ("another\n", "is another one"), ("two words", "is damaged"),
     ("\xff\x00", "is damaged"), ("", "is damaged")],
)  # fmt: skip
def test_a_token_that_is_not_the_owners(
    services: Services, authority: Path, content: str | None, words: str
) -> None:
    file = authority / running.OWNER_TOKEN
    file.unlink()
    if content is not None:
        file.write_bytes(content.encode("latin-1"))
    with pytest.raises(StoreError, match=words) as said:
        check(services)
    assert said.value.argument == "new_token"


def test_a_new_token_is_asked_for(services: Services, authority: Path) -> None:
    before = running.owner_token(services)
    (authority / running.OWNER_TOKEN).unlink()
    check(services, renews_token=True)
    assert running.owner_token(services, renewed=True) != before
    check(services)


def test_a_signing_key_that_phones_do_not_trust(services: Services, authority: Path) -> None:
    trusted = fingerprint(signing_key(authority))
    (authority / SIGNING_KEY).unlink()
    with pytest.raises(StoreError, match="is missing, and paired phones trust"):
        check(services)
    assert not (authority / SIGNING_KEY).exists()
    assert fingerprint(signing_key(authority)) != trusted
    with pytest.raises(StoreError, match=r"is another one, .* pair all phones again"):
        check(services)


def test_a_new_signing_key_is_asked_for(services: Services, authority: Path) -> None:
    before = fingerprint(signing_key(authority))
    check(services, renews_key=True)
    running.trust_key(services, renewed=True)
    assert fingerprint(signing_key(authority)) != before
    check(services)


def test_a_damaged_signing_key(services: Services, authority: Path) -> None:
    (authority / SIGNING_KEY).write_bytes(b"nonsense")
    with pytest.raises(StoreError, match="is no key"):
        check(services)


@pytest.mark.parametrize(("limits", "after"), [((64, 700), 600), ((650, 700), 650)])
def test_as_many_files_as_wanted_may_be_open(
    monkeypatch: pytest.MonkeyPatch, limits: tuple[int, int], after: int
) -> None:
    told = [limits]
    monkeypatch.setattr(resource, "getrlimit", lambda _: told[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, wanted: told.append(wanted))
    running.allow_open_files(600)
    assert told[-1] == (after, 700)


def test_too_few_open_files_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (12, 12))
    with pytest.raises(InputError, match=r"12 files at once, wanted 600 .* ulimit -n 600"):
        running.allow_open_files(600)


def test_one_address_has_a_share(start_server: Start) -> None:
    server = start_server(speaks="https", address_connections=2)
    with raw(server.url) as first, raw(server.url), raw(server.url):
        assert first.recv(1) == b""


def test_behind_a_proxy_all_come_from_one_address(start_server: Start) -> None:
    server = start_server(address_connections=2, connections=3)
    with raw(server.url) as first, raw(server.url), raw(server.url):
        first.settimeout(20)
        assert httpx.get(server.url + "api/version").is_success
        assert first.recv(1) == b""
