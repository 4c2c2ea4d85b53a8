"""Sends the tracker's streams by UDP and TCP, without ever waiting for a receiver.

One thread with an event loop encodes the streams and has all sockets. What a receiver does not take
is kept up to a bound; beyond it the receiver is disconnected. Connections are tried again.
"""

from __future__ import annotations

import asyncio
import os
import socket
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

from msg_adapters.outgoing.outputs import STREAMS, View
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import Estimates, Pose
from phd_jdtc_ros.transport import sockets

# Time after which a connection is tried again, seconds.
RETRY_S = 5.0
# Largest number of clients at one destination, of bytes that wait for one of them, and of scans
# that wait to be encoded.
MOST_CLIENTS, MOST_BYTES, MOST_WAITING = 50, 2**20, 4


class Destination(NamedTuple):
    """Where a stream is sent."""

    form: str  # The stream's format, see `Stream.form`
    scheme: str  # One of udp, tcp, and listen: a port at which TCP clients connect
    address: sockets.Address

    def __str__(self) -> str:
        return f"{self.form}+{self.scheme}://{self.address}"


def destination(text: str) -> Destination:
    """Parse a destination; raise `ValueError` if the text is not one."""
    form, _, rest = text.partition("+")
    scheme, _, place = rest.partition("://")
    forms = list(dict.fromkeys(row.form for row in STREAMS))
    with suppress(ValueError):
        found = Destination(form, scheme, sockets.address(place))
        group = found.address.multicast
        by_udp = scheme == "udp" and form in [row.form for row in STREAMS if row.datagrams]
        if form in forms and (by_udp or (scheme in ("tcp", "listen") and not group)):
            return found
    raise ValueError(
        f"{text} given, must be one of {', '.join(forms)}, +udp://, +tcp:// or +listen://, and an "
        "IPv4 address and a port, such as nmea+udp://127.0.0.1:10110"
    )


class Link:
    """The sockets of one destination; all but the fields below belong to the loop's thread."""

    def __init__(self, where: Destination) -> None:
        self.where = where
        self.fault = ""  # Why nothing can be sent; empty if it can, or if it waits for clients
        self.stalled = 0  # Number of receivers that were disconnected because they did not read
        self.sent = 0  # Number of messages that were passed on
        self._open: set[Any] = set()
        self._greeted: set[Any] = set()
        # A port of this machine is taken at once, so that one that is in use is refused.
        listens = where.scheme == "listen"
        self._port = socket.create_server(where.address) if listens else None
        self._server: asyncio.Server | None = None

    @property
    def receivers(self) -> int:
        """Number of receivers; an address that datagrams are sent to counts as one."""
        return len(self._open)

    async def run(self) -> None:
        """Connect, again and again, or wait for clients, until cancelled."""
        while True:
            try:
                await self._connect()
                self.fault = f"{self.where}: disconnected"
            except (OSError, asyncio.TimeoutError) as error:
                number = getattr(error, "errno", None)
                self.fault = f"{self.where}: {os.strerror(number) if number else 'no answer'}"
            await asyncio.sleep(RETRY_S)

    async def _connect(self) -> None:
        """Keep a connection until it ends, or wait forever."""
        if self.where.scheme == "tcp":
            connecting = asyncio.open_connection(*self.where.address)
            await self._serve(*await asyncio.wait_for(connecting, RETRY_S))
            return
        if self._port is not None:
            self._server = await asyncio.start_server(self._accept, sock=self._port)
        else:
            made = asyncio.get_running_loop().create_datagram_endpoint(
                asyncio.DatagramProtocol, sock=sockets.sender(self.where.address, "")
            )
            self._open.add((await made)[0])
            self.fault = ""
        await asyncio.Event().wait()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # Before Python 3.12 asyncio logs an error if this is cancelled.
        with suppress(asyncio.CancelledError):
            await self._serve(reader, writer)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Keep a connection until it ends; what is received is discarded."""
        if len(self._open) < MOST_CLIENTS:
            self.fault = ""
            self._open.add(writer.transport)
            # The system would keep some megabytes more of what a receiver does not read.
            own = writer.get_extra_info("socket")
            own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MOST_BYTES // 8)
            with suppress(OSError):
                while await reader.read(4096):
                    pass
            self._open.discard(writer.transport)
        writer.transport.abort()

    def write(self, messages: Sequence[bytes], greet: Callable[[], list[bytes]]) -> None:
        """Pass messages to all receivers; disconnect those that do not read, or leave them out.

        A new receiver gets first what `greet` returns.
        """
        self._greeted &= self._open
        for transport in list(self._open):
            if transport not in self._greeted:
                self._greeted.add(transport)
                transport.write(b"".join(greet())) if self.where.scheme != "udp" else None
            if transport.get_write_buffer_size() > MOST_BYTES:
                self.stalled += 1
                if self.where.scheme != "udp":
                    self._open.discard(transport)
                    transport.abort()
            elif self.where.scheme == "udp":
                for message in messages:
                    transport.sendto(message)
            else:
                transport.write(b"".join(messages))
        self.sent += len(messages)

    def close(self) -> None:
        """Close all sockets."""
        for transport in self._open:
            transport.abort()
        self._open.clear()
        if self._server is not None:
            self._server.close()
        if self._port is not None:
            self._port.close()


class Senders:
    """The streams that are wanted by the node's parameters, and their destinations.

    Raise `ConfigError` for a destination of this machine that cannot be opened.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._rows = [row for row in STREAMS if row.switch in values["outputs"]]
        forms = {row.form for row in self._rows}
        self.links: list[Link] = []  # To all destinations of these streams
        # Estimates to be encoded in the thread, with own ship's pose. If it cannot follow, the
        # oldest are left out.
        self._waiting: deque[tuple[Estimates, View, Pose | None]] = deque(maxlen=MOST_WAITING)
        self._thread: threading.Thread | None = None
        for where in map(destination, values["destinations"] if forms else ()):
            try:
                self.links += [Link(where)] if where.form in forms else []
            except OSError as error:
                self.close()
                reason = os.strerror(error.errno or 0)
                raise ConfigError(f"destinations: {where} given, {reason}") from error
        if self.links:
            self._loop = asyncio.new_event_loop()
            self._tasks = [self._loop.create_task(link.run()) for link in self.links]
            self._thread = threading.Thread(
                target=self._loop.run_forever, name="senders", daemon=True
            )
            self._thread.start()

    def send(self, found: Estimates, view: View) -> None:
        """Send filtered estimates on each stream that somebody receives."""
        if any(link.receivers for link in self.links):
            self._waiting.append((found, view, view.own_pose(found.stamp_ns)))
            self._loop.call_soon_threadsafe(self._encode)

    def _encode(self) -> None:
        """Encode the oldest estimates that wait, and pass them to the receivers."""
        if not self._waiting:  # Later ones have replaced them
            return
        given = self._waiting.popleft()
        for row in self._rows:
            links = [link for link in self.links if link.where.form == row.form]
            if any(link.receivers for link in links):
                messages = row.encode(*given)
                for link in links:
                    link.write(messages, partial(row.greet, *given[:2]))

    def close(self) -> None:
        """Close all sockets, and end the thread."""
        if self._thread is not None:
            asyncio.run_coroutine_threadsafe(self._stop(), self._loop).result()
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
            self._loop.close()
            self._thread = None
        for link in self.links:
            link.close()
        self.links = []

    async def _stop(self) -> None:
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
        for link in self.links:
            link.close()
        await asyncio.sleep(0.0)
