"""Who may stay connected, by a planted clock."""

from __future__ import annotations

import socket

import pytest

from elfslam.serve.network.visitors import CountingListener, Visitors, redirect_to_https, visitor_of


class Hall:
    """Visitors whose time is told, and the numbers of the connections that were ended."""

    def __init__(self, most: int, most_of_one: int) -> None:
        self.now_s, self.ended = 0.0, list[int]()
        self.visitors = Visitors(most, most_of_one, lambda: self.now_s)

    def enter(self, number: int, address: str) -> bool:
        """A connection, a second after the last."""
        self.now_s += 1
        return self.visitors.enter(number, address, lambda: self.ended.append(number))

    def works_for(self, *numbers: int) -> None:
        """The server, not the client, has something to do."""
        for number in numbers:
            self.visitors.of(number).waiting_since_s = None


def test_an_address_over_its_share_ends_its_own_longest_wait() -> None:
    hall = Hall(most=10, most_of_one=2)
    assert [hall.enter(1, "10.0.0.9"), hall.enter(2, "10.0.0.1")] == [True, True]
    assert [hall.enter(3, "10.0.0.1"), hall.enter(4, "10.0.0.1")] == [True, True]
    assert hall.ended == [2]
    hall.works_for(3)
    assert hall.enter(5, "10.0.0.1")
    assert hall.ended == [2, 4]


def test_an_address_that_is_worked_for_is_refused_more() -> None:
    hall = Hall(most=10, most_of_one=2)
    hall.enter(1, "10.0.0.1")
    hall.enter(2, "10.0.0.1")
    hall.works_for(1, 2)
    assert not hall.enter(3, "10.0.0.1")
    assert hall.enter(4, "10.0.0.2")
    assert hall.ended == []
    hall.visitors.leave(1)
    assert hall.enter(5, "10.0.0.1")


def test_a_full_house_ends_whoever_waits_longest() -> None:
    hall = Hall(most=3, most_of_one=3)
    for number in (1, 2, 3):
        hall.enter(number, f"10.0.0.{number}")
    hall.works_for(1)
    assert hall.enter(4, "10.0.0.4")
    assert hall.ended == [2]
    hall.works_for(3, 4)
    assert not hall.enter(5, "10.0.0.5")
    hall.visitors.of(4).waiting_since_s = hall.now_s
    assert hall.enter(6, "10.0.0.6")
    assert hall.ended == [2, 4]


def test_who_sends_at_the_pace_outlasts_who_drips() -> None:
    hall = Hall(most=3, most_of_one=3)
    for number in (1, 2, 3):
        hall.enter(number, f"10.0.0.{number}")
    hall.now_s = 100.0
    hall.visitors.of(1).credit(1000.0, hall.now_s)
    hall.visitors.of(2).credit(0.002, hall.now_s)
    hall.visitors.of(3).credit(50.0, hall.now_s)
    for number in (4, 5):
        hall.enter(number, "10.0.0.9")
    assert hall.ended == [2, 3]


def test_time_cannot_be_saved_up() -> None:
    hall = Hall(most=1, most_of_one=1)
    hall.enter(1, "10.0.0.1")
    hall.visitors.of(1).credit(1000.0, 50.0)
    assert hall.visitors.of(1).waiting_since_s == 50.0


@pytest.mark.parametrize(
    ("address", "visitor"),
    [
        ("10.0.0.1", "10.0.0.1"),
        ("::ffff:8.8.8.8", "8.8.8.8"),
        ("2a00:1450:4001:82a::200e", "2a00:1450:4001:82a::/64"),
        ("2a00:1450:4001:82a:1:2:3:4", "2a00:1450:4001:82a::/64"),
        ("fe80::1%eth0", "fe80::1"),
        ("::1", "::1"),
    ],
)
def test_who_is_at_an_address(address: str, visitor: str) -> None:
    assert visitor_of(address) == visitor


def test_a_door_counts_until_a_connection_is_closed() -> None:
    visitors = Visitors(10, 1)
    door = CountingListener(socket.create_server(("127.0.0.1", 0)), visitors)
    with door, socket.create_connection(door.getsockname()) as first:
        connection, _ = door.accept()
        visitors.of(connection.fileno()).waiting_since_s = None
        with socket.create_connection(door.getsockname()) as second:
            with pytest.raises(ConnectionAbortedError):
                door.accept()
            assert second.recv(1) == b""
        connection.close()
        assert first.recv(1) == b""
        with socket.create_connection(door.getsockname()):
            connection, _ = door.accept()
            connection.close()


def test_a_door_lets_a_newcomer_in_and_the_longest_wait_out() -> None:
    visitors = Visitors(10, 1)
    door = CountingListener(socket.create_server(("127.0.0.1", 0)), visitors)
    with door, socket.create_connection(door.getsockname()) as first:
        kept, _ = door.accept()
        with socket.create_connection(door.getsockname()) as second:
            newcomer, _ = door.accept()
            assert first.recv(1) == b""
            assert kept.recv(1) == b""
            newcomer.sendall(b"x")
            assert second.recv(1) == b"x"
            newcomer.close()
        kept.close()


@pytest.mark.parametrize(
    ("begun", "where"),
    [
        (b"GET / HTTP/1.1\r\nHost: a.b:81\r\n\r\n", b"https://a.b:81/"),
        (b"HEAD /desk?x=1 HTTP/1.0\r\nA: b\r\nhost:10.0.0.7\r\n", b"https://10.0.0.7/desk?x=1"),
        (b"GET / HTTP/1.1\r\nHost: [fd12::1]:81\r\n", b"https://[fd12::1]:81/"),
    ],
)
def test_a_browser_without_tls_is_sent_to_https(begun: bytes, where: bytes) -> None:
    answer = redirect_to_https(begun)
    assert answer is not None
    assert b"\r\nLocation: " + where + b"\r\n" in answer
    assert answer.endswith(b"\r\n\r\n")


@pytest.mark.parametrize(
    "begun",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"POST / HTTP/1.1\r\nHost: a\r\n",
        b"GET / HTTP/1.1\r\n\r\nHost: a\r\n",
        b"GET //x\r\ny HTTP/1.1\r\nHost: a\r\n",
        b"GET / HTTP/1.1\r\nHost: a/b\r\n",
        b"",
    ],
)
def test_what_is_no_request_of_a_browser_is_not_answered(begun: bytes) -> None:
    assert redirect_to_https(begun) is None
