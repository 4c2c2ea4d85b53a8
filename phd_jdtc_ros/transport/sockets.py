"""Sockets of UDP, and a thread that receives bytes: datagrams, and streams of TCP and serial lines.

A stream that cannot be opened, or that ends, is opened again after a while, because receivers are
restarted and unplugged.
"""

from __future__ import annotations

import ipaddress
import os
import selectors
import socket
import struct
import termios
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from io import FileIO
from typing import NamedTuple, TypeAlias

from .network import Datagram

# This option makes Linux report the number of lost datagrams; Python does not define it.
SO_RXQ_OVFL = 40


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


def interface_faults(text: str) -> list[str]:
    """Return the fault of the address of a network interface, none for an empty text."""
    try:
        if text:
            address(f"{text}:1")
    except ValueError:
        return [f"interface: {text} given, must be an IPv4 address"]
    return []


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
        # Upper bound of unread datagrams in the kernel, bytes.
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**22)
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


LARGEST = 65_535
# Upper bounds of unread data in the node, bytes and pieces. They hold what ten radars send in five
# seconds; the most expensive content takes about two seconds to read.
MAX_BYTES, MAX_WAITING = 2**19, 10_000
# Timeout of a wait for data, seconds: a receiver's thread ends this soon after `close`.
POLL_S = 0.1
# Time after which a stream that has ended is opened again, seconds.
RETRY_S = 2.0
_COUNT = struct.Struct("I")


class Tcp(NamedTuple):
    """A server of TCP that sends to its clients."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"tcp://{self.host}:{self.port}"

    def open(self) -> socket.socket:
        """Return it open, without waiting for the other side; raise `OSError`.

        A server that does not answer shows when it is read.
        """
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            sock.setblocking(False)
            # A server that was cut off sends nothing; this finds out.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            sock.connect_ex((socket.gethostbyname(self.host), self.port))
        except OSError:
            sock.close()
            raise
        return sock


class Serial(NamedTuple):
    """A serial line of eight bits without parity."""

    path: str
    baud: int

    def __str__(self) -> str:
        return f"serial:{self.path}:{self.baud}"

    def open(self) -> FileIO:
        """Return it open; raise `OSError`."""
        line = FileIO(os.open(self.path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK))
        try:
            speed = getattr(termios, f"B{self.baud}")
            *_, characters = termios.tcgetattr(line)
            control = termios.CS8 | termios.CREAD | termios.CLOCAL
            termios.tcsetattr(line, termios.TCSANOW, [0, 0, control, 0, speed, speed, characters])
        except termios.error as error:
            line.close()
            raise OSError(error.args[0], "is no serial line", self.path) from error
        return line


Input: TypeAlias = "Address | Tcp | Serial"


def input_of(text: str) -> Input:
    """Parse an input: ``HOST:PORT`` or ``udp://HOST:PORT``, ``tcp://HOST:PORT``, ``serial:...``.

    A serial line has its path and its speed in baud, 38400 without. Raise `ValueError` if the text
    is none of these.
    """
    forms = (
        "an IPv4 address and a port, such as 239.1.1.1:8600, tcp://HOST:PORT, or "
        "serial:/dev/ttyUSB0:38400"
    )
    kind, _, rest = text.partition(":")
    try:
        if kind == "serial":
            path, _, baud = rest.partition(":")
            speed = int(baud or 38400)
            if path and hasattr(termios, f"B{speed}"):
                return Serial(path, speed)
        elif kind == "tcp":
            host, _, port = rest.removeprefix("//").rpartition(":")
            if host and 0 < int(port) < 2**16:
                return Tcp(host, int(port))
        else:
            return address(text.removeprefix("udp://"))
    except ValueError:
        pass
    raise ValueError(f"{text} given, must be {forms}")


class _Connection:
    """A stream with its present connection, if there is one."""

    def __init__(self, stream: Tcp | Serial) -> None:
        self.stream = stream
        self.opened: socket.socket | FileIO | None = None
        self.count = 0  # Connections so far
        self.again_s = 0.0  # When it may be opened next
        self.fault = ""  # Why there is no connection

    @property
    def source(self) -> str:
        """Name of the connection: a sentence does not go on in the next one."""
        return f"{self.stream} {self.count}"


class Receiver:
    """Receives from all inputs in a thread until it is closed.

    `arrived` is called in the thread when data is available. `received` counts its pieces. An
    `OSError` of an address of UDP that cannot be opened has it as its ``filename``; streams are
    opened while the thread runs.
    """

    def __init__(
        self, inputs: Sequence[Input], interface: str, arrived: Callable[[], object]
    ) -> None:
        self._waiting: deque[Datagram] = deque()
        # Each counter is written by a single thread.
        self._bytes_in = self._bytes_out = 0
        self._arrived = arrived
        self._selector = selectors.DefaultSelector()
        self._lost_by_kernel: dict[str, int] = {}
        self._overflow = self.received = 0
        self.ended: Counter[str] = Counter()  # Ends of connections by input
        self._stopped = threading.Event()
        self._streams = [_Connection(each) for each in inputs if not isinstance(each, Address)]
        try:
            for where in inputs:
                if isinstance(where, Address):
                    self._open(where, interface)
        except OSError:
            self._close_all()
            raise
        self._thread = threading.Thread(target=self._receive, name="receiver", daemon=True)
        self._thread.start()

    def _open(self, where: Address, interface: str) -> None:
        try:
            sock = receiving_socket(where, interface)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(where)) from error
        self._selector.register(sock, selectors.EVENT_READ, (sock, str(where)))

    @property
    def lost(self) -> int:
        """Number of dropped pieces of data."""
        return self._overflow + sum(self._lost_by_kernel.values())

    @property
    def waiting(self) -> int:
        """Number of pieces in the queue."""
        return len(self._waiting)

    @property
    def disconnected(self) -> Mapping[str, str]:
        """The streams that nothing comes from, each with the reason."""
        return {str(each.stream): each.fault for each in self._streams if each.fault}

    def take(self) -> Datagram | None:
        """Remove and return the oldest piece of data, None if the queue is empty."""
        if not self._waiting:
            return None
        found = self._waiting.popleft()
        self._bytes_out += len(found.data)
        return found

    def close(self) -> None:
        """End the thread and close all inputs."""
        self._stopped.set()
        self._thread.join()
        self._close_all()

    def _close_all(self) -> None:
        for key in list((self._selector.get_map() or {}).values()):
            opened, _ = key.data
            opened.close()
        self._selector.close()

    def _receive(self) -> None:
        while not self._stopped.is_set():
            for each in self._streams:
                if each.opened is None and time.monotonic() >= each.again_s:
                    self._connect(each)
            for key, _ in self._selector.select(POLL_S):
                opened, where = key.data
                if isinstance(where, _Connection):
                    self._read_stream(where)
                else:
                    self._read_datagram(opened, where)

    def _connect(self, each: _Connection) -> None:
        try:
            each.opened = each.stream.open()
        except OSError as error:
            each.fault = error.strerror or str(error)
            each.again_s = time.monotonic() + RETRY_S
            return
        # The fault stays until something is received.
        each.count += 1
        self._selector.register(each.opened, selectors.EVENT_READ, (each.opened, each))

    def _read_stream(self, each: _Connection) -> None:
        """Read from a stream; a connection that has failed is readable too."""
        opened, fault = each.opened, "the connection has ended"
        if opened is None:
            return
        data = b""
        try:
            data = os.read(opened.fileno(), LARGEST)
        except BlockingIOError:
            return
        except OSError as error:
            fault = error.strerror or str(error)
        if data:
            each.fault = ""
            self._keep(data, each.source)
            return
        self._selector.unregister(opened)
        # It is counted before another thread can see that it is disconnected.
        self.ended[str(each.stream)] += 1
        with closing(opened):
            each.opened, each.fault = None, fault
        each.again_s = time.monotonic() + RETRY_S

    def _read_datagram(self, sock: socket.socket, where: str) -> None:
        """Read one datagram; the loop polls again for further ones."""
        # An error is of an earlier datagram, or the datagram is gone.
        with suppress(OSError):
            data, extra, _, source = sock.recvmsg(LARGEST, socket.CMSG_SPACE(_COUNT.size))
            for level, kind, value in extra:
                if (level, kind) == (socket.SOL_SOCKET, SO_RXQ_OVFL):
                    (self._lost_by_kernel[where],) = _COUNT.unpack(value[: _COUNT.size])
            self._keep(data, f"{source[0]} to {where}")

    def _keep(self, data: bytes, source: str) -> None:
        self.received += 1
        size = self._bytes_in - self._bytes_out + len(data)
        if size > MAX_BYTES or len(self._waiting) >= MAX_WAITING:
            self._overflow += 1
            return
        self._bytes_in += len(data)
        self._waiting.append(Datagram(data, time.time_ns(), source))
        self._arrived()
