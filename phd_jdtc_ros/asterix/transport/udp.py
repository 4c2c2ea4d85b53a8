"""Sends and receives UDP: addresses, multicast groups, and a receiving thread."""

from __future__ import annotations

import ipaddress
import selectors
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from .network import Datagram

LARGEST = 65_535
# Upper bounds of unread datagrams: in the kernel, bytes, and in the node, bytes and number. They
# hold what ten radars send in five seconds; the most expensive content takes about two seconds to
# read.
KERNEL_BYTES, MAX_BYTES, MAX_WAITING = 2**22, 2**19, 10_000
# Timeout of a wait for datagrams, seconds: a receiver's thread ends this soon after `close`.
POLL_S = 0.1
# This option makes Linux report the number of lost datagrams; Python does not define it.
SO_RXQ_OVFL = 40
_COUNT = struct.Struct("I")


class Address(NamedTuple):
    """An IPv4 address and a port."""

    host: str
    port: int

    @property
    def multicast(self) -> bool:
        """Whether it is the address of a multicast group."""
        return ipaddress.IPv4Address(self.host).is_multicast

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def address(text: str) -> Address:
    """Parse an address ``HOST:PORT``; raise `ValueError` if the text is not one."""
    host, _, port = text.rpartition(":")
    try:
        ipaddress.IPv4Address(host)
        number = int(port)
    except ValueError:
        number = 0
    if not 0 < number < 2**16:
        raise ValueError(
            f"{text} given, must be an IPv4 address and a port, such as 239.1.1.1:8600"
        )
    return Address(host, number)


@contextmanager
def _datagram_socket() -> Iterator[socket.socket]:
    """Yield a socket that does not block; close it if the block fails."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setblocking(False)
        yield sock
    except OSError:
        sock.close()
        raise


def receiving_socket(where: Address, interface: str) -> socket.socket:
    """Return a socket that receives datagrams for a local address, or a multicast group to join.

    `interface` is the address of the network interface that joins a group; empty for the
    system's choice.
    """
    with _datagram_socket() as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, KERNEL_BYTES)
        if where.multicast:
            # A group may have several listeners, a local address only one.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        sock.bind(where)
        if where.multicast:
            group = socket.inet_aton(where.host) + socket.inet_aton(interface or "0.0.0.0")
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    return sock


def sender(where: Address, interface: str) -> socket.socket:
    """Return a socket that sends to an address; to a group with a hop limit of one."""
    with _datagram_socket() as sock:
        if where.multicast:
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
            if interface:
                own = socket.inet_aton(interface)
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
        sock.connect(where)
    return sock


class Receiver:
    """Receives datagrams in a thread until it is closed.

    `arrived` is called in the thread when datagrams are available. `received` counts the datagrams.
    An `OSError` of an address that cannot be opened has it as its ``filename``.
    """

    def __init__(
        self, inputs: Sequence[Address], interface: str, arrived: Callable[[], object]
    ) -> None:
        self._waiting: deque[Datagram] = deque()
        # Each counter is written by a single thread.
        self._bytes_in = self._bytes_out = 0
        self._arrived = arrived
        self._selector = selectors.DefaultSelector()
        self._lost_by_kernel: dict[str, int] = {}
        self._overflow = self.received = 0
        self._stopped = threading.Event()
        try:
            for where in inputs:
                self._open(where, interface)
        except OSError:
            self._close_sockets()
            raise
        self._thread = threading.Thread(target=self._receive, name="udp", daemon=True)
        self._thread.start()

    def _open(self, where: Address, interface: str) -> None:
        try:
            sock = receiving_socket(where, interface)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(where)) from error
        self._selector.register(sock, selectors.EVENT_READ, (sock, str(where)))

    @property
    def lost(self) -> int:
        """Number of dropped datagrams."""
        return self._overflow + sum(self._lost_by_kernel.values())

    @property
    def waiting(self) -> int:
        """Number of datagrams in the queue."""
        return len(self._waiting)

    def take(self) -> Datagram | None:
        """Remove and return the oldest datagram, None if the queue is empty."""
        if not self._waiting:
            return None
        found = self._waiting.popleft()
        self._bytes_out += len(found.data)
        return found

    def close(self) -> None:
        """End the thread and close the sockets."""
        self._stopped.set()
        self._thread.join()
        self._close_sockets()

    def _close_sockets(self) -> None:
        for key in list((self._selector.get_map() or {}).values()):
            key.data[0].close()
        self._selector.close()

    def _receive(self) -> None:
        while not self._stopped.is_set():
            for key, _ in self._selector.select(POLL_S):
                self._read(*key.data)

    def _read(self, sock: socket.socket, where: str) -> None:
        """Read one datagram; the loop polls again for further ones."""
        try:
            data, extra, _, source = sock.recvmsg(LARGEST, socket.CMSG_SPACE(_COUNT.size))
        except OSError:  # an error of an earlier datagram, or the datagram is gone
            return
        for level, kind, value in extra:
            if (level, kind) == (socket.SOL_SOCKET, SO_RXQ_OVFL):
                (self._lost_by_kernel[where],) = _COUNT.unpack(value[: _COUNT.size])
        self.received += 1
        size = self._bytes_in - self._bytes_out + len(data)
        if size > MAX_BYTES or len(self._waiting) >= MAX_WAITING:
            self._overflow += 1
            return
        self._bytes_in += len(data)
        self._waiting.append(Datagram(data, time.time_ns(), f"{source[0]} to {where}"))
        self._arrived()
