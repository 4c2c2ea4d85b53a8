"""The server of the live picture: whom it serves, and browsers that do not read."""

import http.client
import itertools
import json
import re
import socket
import time

import numpy as np
import pytest

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import Estimates
from phd_jdtc_ros.nodes import picture_server as server
from phd_jdtc_ros.nodes.picture_server import Server, is_loopback


@pytest.fixture
def serve():
    """Return a function that starts a server whose updates are numbered."""
    made = []

    def start(token="", size=10, host="127.0.0.1"):
        counter = itertools.count()

        def take():
            return {"tracks": server.event("tracks", {"n": next(counter), "text": "x" * size})}

        first = {"head": server.event("head", {})}
        made.append(Server(host, 0, token, lambda: "<p>page</p>", lambda: first, take))
        return made[-1]

    yield start
    for each in made:
        each.close()


def answer(port, path="/", host=None):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", path, headers={"Host": host} if host else {})
    return connection.getresponse()


def events(reply, count):
    """Return the kinds and the contents of the next events."""
    found = []
    while len(found) < count:
        line = reply.fp.readline().decode()
        if line.startswith("event: "):
            kind = line[7:].strip()
            found.append((kind, json.loads(reply.fp.readline()[6:])))
    return found


def until(fits, timeout_s=20.0):
    end = time.monotonic() + timeout_s
    while not fits() and time.monotonic() < end:
        time.sleep(0.02)
    assert fits()


def test_browser_gets_the_page_what_there_is_and_then_what_is_new(serve):
    port = serve().port
    page = answer(port)
    assert (page.status, page.read()) == (200, b"<p>page</p>")
    assert "default-src 'none'" in page.headers["Content-Security-Policy"]
    (head, *news) = events(answer(port, "/events"), 4)
    assert head == ("head", {})
    assert [content["n"] for _, content in news] == [0, 1, 2]


def test_nothing_is_encoded_while_nobody_looks(serve):
    own = serve()
    time.sleep(4 * server.PERIOD_S)
    reply = answer(own.port, "/events")
    assert events(reply, 2)[1][1]["n"] == 0
    reply.fp.close()
    until(lambda: not own.clients)


@pytest.mark.parametrize(
    ("token", "path", "host", "status"),
    [
        ("", "/", None, 200),
        ("", "/", "localhost:8321", 200),
        # A page of another site whose name leads to this machine must not read the picture.
        ("", "/", "evil.example", 403),
        ("", "/events", "evil.example:80", 403),
        ("secret", "/", None, 403),
        ("secret", "/?token=wrong", None, 403),
        ("secret", "/events?token=", None, 403),
        ("secret", "/?token=secret", None, 200),
        ("", "/other", None, 404),
    ],
)
def test_only_who_may_look_does(serve, token, path, host, status):
    assert answer(serve(token).port, path, host).status == status


def test_nothing_but_get_is_allowed(serve):
    connection = http.client.HTTPConnection("127.0.0.1", serve().port, timeout=10)
    connection.request("POST", "/", body="x")
    assert connection.getresponse().status == 405


def test_browser_that_does_not_read_is_dropped_and_others_go_on(serve, monkeypatch):
    monkeypatch.setattr(server, "PATIENCE_S", 1.0)
    own = serve(size=400_000)
    stalled = socket.create_connection(("127.0.0.1", own.port))
    stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    stalled.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    until(lambda: len(own.clients) == 1)
    reader = answer(own.port, "/events")
    numbers = [content["n"] for _, content in events(reader, 25)[1:]]
    assert own.dropped == 1
    assert len(own.clients) == 1
    assert numbers == sorted(set(numbers))
    stalled.close()


def test_what_waits_for_a_browser_is_only_the_newest_of_each_kind(serve, monkeypatch):
    monkeypatch.setattr(server, "PERIOD_S", 0.05)
    # No buffer of the system has room for the first update.
    own = serve(size=10**7)
    stalled = socket.create_connection(("127.0.0.1", own.port))
    stalled.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    until(lambda: len(own.clients) == 1)
    (client,) = own.clients

    def waiting():
        return [int(re.search(rb'"n":(\d+)', event)[1]) for event in [*client.waiting.values()]]

    until(lambda: max(waiting(), default=0) > 4)
    assert len(waiting()) == 1
    stalled.close()


def test_more_browsers_than_allowed_are_refused(serve, monkeypatch):
    monkeypatch.setattr(server, "MOST_CLIENTS", 2)
    port = serve().port
    looking = [answer(port, "/events") for _ in range(2)]
    assert answer(port, "/events").status == 503
    assert [each.status for each in looking] == [200, 200]


def test_port_that_is_taken_is_refused_by_its_number(serve):
    port = serve().port
    with pytest.raises(ConfigError, match=f"port: {port} given"):
        Server("127.0.0.1", port, "", str, dict, dict)


@pytest.mark.parametrize(
    ("host", "local"),
    [
        *((host, True) for host in ("127.0.0.1", "127.1.2.3", "::1", "localhost")),
        *((host, False) for host in ("0.0.0.0", "192.168.1.5", "::", "radar.example")),
    ],
)
def test_loopback_is_told_from_other_addresses(host, local):
    assert is_loopback(host) is local


def test_updates_have_the_tracks_with_numbers_in_the_units_of_the_page():
    count = 3
    state = np.array([[1000.04, 10.0, -2000.0, 0.0, 0.0]] * count)
    covariance = np.diag([400.0, 1.0, 100.0, 1.0, 1e-6])[None].repeat(count, axis=0)
    found = Estimates(
        *(5 * 10**9, 0, state, covariance, np.full(count, 0.996), np.ones((count, 1))),
        *(np.zeros(count, dtype=int), np.array([7, 0, 12])),
    )
    sent = json.loads(server.event("tracks", server.of_tracks(found)).split(b"data: ")[1])
    assert (sent["time_s"], sent["number"], sent["x"]) == (5.0, [7, 12], [1000.0, 1000.0])
    assert (sent["vx"], sent["course"], sent["weight"]) == ([100, 100], [90, 90], [100, 100])
    # Steps of a sixteenth of a factor of two above a centimetre.
    major = [0.01 * 2 ** (step / 16) for step in sent["major"]]
    assert major == pytest.approx([20.0] * 2, rel=0.03)
