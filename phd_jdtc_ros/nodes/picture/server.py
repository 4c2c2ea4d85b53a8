"""Serves the picture to browsers: a page, and what is new as server-sent events.

One thread with an event loop has all connections. What a browser has not yet received is replaced
by what is newer, so that nothing grows, however long it stays; one that does not read is dropped.
Nothing that a browser sends has an effect.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from aiohttp import web

from phd_jdtc_ros.configuration.schema import ConfigError

# Largest number of browsers, time between two looks at what is new, and time in which a browser
# must read, seconds; and between two events that only show that the server is there.
MOST_CLIENTS, PERIOD_S, PATIENCE_S, QUIET_S = 20, 0.25, 10.0, 15.0
LOCAL_NAMES = ("localhost", "127.0.0.1", "[::1]")
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
        if self._loopback and name not in LOCAL_NAMES:
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
