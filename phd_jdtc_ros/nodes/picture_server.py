"""Serves the picture to browsers: a page, and what is new as server-sent events.

One thread with an event loop has all connections. What a browser has not yet received is replaced
by what is newer, so that nothing grows, however long it stays; one that does not read is dropped.
Nothing that a browser sends has an effect.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from aiohttp import web

from msg_adapters.targets import vertical
from msg_adapters.targets.markers import class_colour
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.conflicts.model import Conflicts, words
from phd_jdtc_ros.core.models.zones import Zone
from phd_jdtc_ros.core.types import FILTERED, Estimates
from phd_jdtc_ros.report.page.picture import AXIS_STEPS, LEAST_AXIS, MARKS, NO_LEVEL, said_of
from phd_jdtc_ros.report.style import RADIUS_95


def head(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page's script has to know, see `page.picture`, by a tracker's parameters."""
    classes = values.get("classes") or ["class_0"]
    heights = any(values.get(f"{name}.fields.height") for name in values.get("sensors", ()))
    return {
        "first": 0,
        "levels": "m" if heights or values.get("state") == "space" else "",
        "ground": None,
        "no_level": NO_LEVEL,
        "axis": [AXIS_STEPS, LEAST_AXIS * RADIUS_95],
        "classes": [{"title": n, "colour": class_colour(k)} for k, n in enumerate(classes)],
        "sources": [FILTERED],
        "hold": {FILTERED: 1},
        "radars": list(values.get("sensors", ())),
        "sites": [],
        "known": {"truth": False, "plots": True, "alarms": True},
        "rings": [],
        "zones": [],
        "amplitudes": [],
        "identities": [],
        "told": [],
        "marks": MARKS,
        "place_unknown": False,
        "columns": [],
    }


def _rounded(values: Any, step: float = 1.0) -> list[int]:
    rounded: list[int] = np.rint(np.asarray(values) / step).astype(np.int64).tolist()
    return rounded


def of_tracks(found: Estimates) -> dict[str, Any]:
    """Return the estimates as columns, in the units of the page's columns; places in metres."""
    found = found.select(found.track_id > 0)
    up, rows = found.known_attributes.height, np.arange(len(found))
    known = np.isfinite(up[:, 0])
    variance, axes = np.linalg.eigh(found.position_covariance)
    semi = np.log2(np.sqrt(np.maximum(variance, LEAST_AXIS**2)) / LEAST_AXIS)
    share = found.class_probability[rows, found.class_id]
    told: list[str] = []
    said: dict[str, Any] = {name: _rounded(v) for name, v in said_of([found], told).items()}
    if said:
        said["source"] = [told[k] for k in said["source"]]
    return {
        "time_s": found.stamp_ns * 1e-9,
        "number": found.track_id.tolist(),
        "x": np.round(found.position[:, 0], 1).tolist(),
        "y": np.round(found.position[:, 1], 1).tolist(),
        "vx": _rounded(found.velocity[:, 0], 0.1),
        "vy": _rounded(found.velocity[:, 1], 0.1),
        "course": _rounded(np.degrees(np.arctan2(*found.velocity.T)) % 360.0),
        "level": _rounded(np.where(known, up[:, 0], NO_LEVEL)),
        "climb": _rounded(np.nan_to_num(up[:, 1]), 0.1),
        "class": found.class_id.tolist(),
        "share": _rounded(share, 0.01),
        "weight": _rounded(found.weight, 0.01),
        "state": found.track_state.tolist(),
        "minor": _rounded(semi[:, 0], 1.0 / AXIS_STEPS),
        "major": _rounded(semi[:, 1], 1.0 / AXIS_STEPS),
        "angle": _rounded(np.degrees(np.arctan2(axes[:, 1, 1], axes[:, 0, 1])) % 180.0),
        "who": vertical.identities(found),
        **said,
    }


def of_plots(x: Any, y: Any, radar: Any) -> dict[str, Any]:
    """Return detections as columns; places in metres."""
    return {"x": _rounded(x), "y": _rounded(y), "radar": radar.tolist()}


def of_carriers(places: Mapping[int, Sequence[float]]) -> dict[str, Any]:
    """Return the places of moving radars, by their index, as columns."""
    return {
        "number": [*places],
        "x": _rounded([place[0] for place in places.values()]),
        "y": _rounded([place[1] for place in places.values()]),
    }


def of_alarms(found: Conflicts, zones: Sequence[Zone]) -> dict[str, Any]:
    """Return the alarms of conflicts as columns, with a text each."""
    rows = np.flatnonzero(found.alarm)
    columns = ("kind", "first", "second", "alarm")
    return {
        **{name: getattr(found, name)[rows].tolist() for name in columns},
        "chance": _rounded(found.probability[rows], 0.01),
        "x": _rounded(found.place[rows, 0]),
        "y": _rounded(found.place[rows, 1]),
        "text": [words(found, row, zones) for row in rows.tolist()],
    }


def event(kind: str, content: Mapping[str, Any] | Sequence[Any]) -> bytes:
    """Return a server-sent event."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return f"event: {kind}\ndata: {text}\n\n".encode()


# Largest number of browsers, time between two looks at what is new, and time in which a browser
# must read, seconds; and between two events that only show that the server is there.
MOST_CLIENTS, PERIOD_S, PATIENCE_S, QUIET_S = 20, 0.25, 10.0, 15.0
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
        "img-src data: blob:; connect-src 'self'; frame-ancestors 'none'"
    ),
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


@dataclass(eq=False)
class Client:
    """A browser, with what it has not yet received: the newest event of each kind."""

    waiting: dict[str, bytes] = field(default_factory=dict)
    news: asyncio.Event = field(default_factory=asyncio.Event)


class Server:
    """The server, which begins at once.

    `page` returns the page, and `take` the events that are new since its last call, by kind; it is
    called in the server's thread and only if somebody looks. `first` returns those that a browser
    needs at first. A `token` is asked for if it is not empty. Raise `ConfigError` if the address
    cannot be had.
    """

    LOCAL_NAMES = ("localhost", "127.0.0.1", "[::1]")

    def __init__(
        self,
        host: str,
        port: int,
        token: str,
        page: Callable[[], str],
        first: Callable[[], Mapping[str, bytes]],
        take: Callable[[], Mapping[str, bytes]],
    ) -> None:
        self._token, self._page, self._first, self._take = token, page, first, take
        self.clients: set[Client] = set()
        self.dropped = 0  # Number of browsers that did not read
        self._loopback = is_loopback(host)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="picture", daemon=True)
        self._thread.start()
        try:
            self.port = asyncio.run_coroutine_threadsafe(
                self._begin(host, port), self._loop
            ).result()
        except OSError as error:
            self._end()
            raise ConfigError(f"port: {port} given, {error.strerror} at {host}") from error

    async def _begin(self, host: str, port: int) -> int:
        application = web.Application(client_max_size=1024)
        application.add_routes([web.get("/", self._show), web.get("/events", self._send)])
        self._runner = web.AppRunner(application, access_log=None, shutdown_timeout=1.0)
        await self._runner.setup()
        site = web.TCPSite(self._runner, host, port)
        try:
            await site.start()
        except OSError:
            await self._runner.cleanup()
            raise
        self._ticks = asyncio.create_task(self._tick())
        return int(self._runner.addresses[0][1])

    def _check(self, request: web.Request) -> None:
        """Refuse a request without the token, or one that a page of another site has made."""
        name = request.host.rpartition(":")[0] if ":" in request.host[-6:] else request.host
        if self._loopback and name not in self.LOCAL_NAMES:
            raise web.HTTPForbidden(text="ask for localhost")
        given = request.query.get("token", "")
        if not hmac.compare_digest(given.encode(), self._token.encode()):
            raise web.HTTPForbidden(text="the token is missing or wrong")

    async def _show(self, request: web.Request) -> web.Response:
        self._check(request)
        return web.Response(text=self._page(), content_type="text/html", headers=HEADERS)

    async def _send(self, request: web.Request) -> web.StreamResponse:
        self._check(request)
        if len(self.clients) >= MOST_CLIENTS:
            raise web.HTTPServiceUnavailable(text=f"{MOST_CLIENTS} browsers look already")
        response = web.StreamResponse(headers={**HEADERS, "Content-Type": "text/event-stream"})
        await response.prepare(request)
        client = Client(dict(self._first()))
        client.news.set()
        self.clients.add(client)
        try:
            while True:
                try:
                    await asyncio.wait_for(client.news.wait(), QUIET_S)
                except asyncio.TimeoutError:
                    client.waiting["quiet"] = b": here\n\n"
                client.news.clear()
                sent, client.waiting = b"".join(client.waiting.values()), {}
                await asyncio.wait_for(response.write(sent), PATIENCE_S)
        except asyncio.TimeoutError:
            self.dropped += 1
            if request.transport is not None:
                request.transport.abort()
        except ConnectionError:
            pass  # The browser has gone
        finally:
            self.clients.discard(client)
        return response

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(PERIOD_S)
            if self.clients and (found := self._take()):
                for client in self.clients:
                    client.waiting.update(found)
                    client.news.set()

    def close(self) -> None:
        """Close all connections, and end the thread."""
        asyncio.run_coroutine_threadsafe(self._stop(), self._loop).result()
        self._end()

    async def _stop(self) -> None:
        others = asyncio.all_tasks() - {asyncio.current_task()}
        await self._runner.cleanup()
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches an address or a name."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
