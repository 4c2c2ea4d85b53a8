"""Browsers at the live picture that connect and do not read."""

from __future__ import annotations

import http.client
import itertools
import json
import socket
import time
from contextlib import ExitStack

from phd_jdtc_ros.nodes.picture_server import PATIENCE_S, PERIOD_S, Server, event

from ..harness.figures import Found, measures, peak_mb

STALLED = 10
# Bytes of an update: 10,000 tracks.
SIZE = 1_200_000
# Largest growth of the memory for each browser, and time beyond the server's patience, seconds.
MOST_MB, BEYOND_S = 8.0, 20.0


@measures(
    "browsers that do not read",
    f"all dropped within {PATIENCE_S + BEYOND_S:g} s; at most +{MOST_MB:g} MB for each; one that "
    "reads goes on",
)
def measure(stalled: int = STALLED) -> Found:
    """Connect browsers that never read, and one that does, until those are dropped."""
    number, text = itertools.count(), "x" * SIZE

    def take() -> dict[str, bytes]:
        return {"tracks": event("tracks", {"n": next(number), "text": text})}

    server = Server("127.0.0.1", 0, "", str, dict, take)
    before = peak_mb()
    try:
        with ExitStack() as clients:
            for _ in range(stalled):
                client = clients.enter_context(socket.socket())
                client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                client.connect(("127.0.0.1", server.port))
                client.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
            connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60.0)
            connection.request("GET", "/events")
            reply, got = connection.getresponse(), list[int]()
            begin_s = time.monotonic()
            while server.dropped < stalled and time.monotonic() - begin_s < PATIENCE_S + BEYOND_S:
                line = reply.fp.readline()
                if line.startswith(b"data: "):
                    got.append(json.loads(line[6:])["n"])
            took_s, dropped = time.monotonic() - begin_s, server.dropped
            connection.close()
    finally:
        server.close()
    growth_mb = peak_mb() - before
    share = len(got) * PERIOD_S / took_s
    in_order = got == sorted(set(got))
    measured = (
        f"{dropped} of {stalled} dropped within {took_s:.1f} s; memory +{growth_mb:.0f} MB; the "
        f"reader got {len(got)} updates, one in {took_s / max(len(got), 1):.2f} s"
    )
    reached = dropped == stalled and growth_mb <= MOST_MB * stalled and in_order and share > 0.0
    return measured, reached, {"dropped": dropped, "memory_mb": growth_mb, "updates": len(got)}
