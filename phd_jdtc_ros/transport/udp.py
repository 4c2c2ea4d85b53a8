"""Sockets of UDP: addresses and multicast groups."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

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
