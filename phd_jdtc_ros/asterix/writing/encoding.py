"""Items to records and data blocks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ..clocks import NS_PER_TICK
from ..messages import DAY
from ..specification import Fixed, layouts

# Of a datagram that passes every network in one piece.
MAX_BLOCK = 1400


def record(category: int, items: Mapping[str, bytes], kind: str = "") -> bytes:
    """Return a record: the selection of its items (FSPEC), and these in the category's order.

    Raises
    ------
    ValueError
        If an item of fixed length has another one.
    """
    layout = layouts(category)[kind]
    places = sorted(layout.place[name] for name in items)
    selection = bytearray(places[-1] // 7 + 1)
    for index in range(len(selection) - 1):
        selection[index] = 1
    body = bytearray()
    for place in places:
        selection[place // 7] |= 0x80 >> place % 7
        name, rule = layout.names[place], layout.rules[place]
        item = items[name or ""]
        if isinstance(rule, Fixed) and len(item) != rule.size:
            raise ValueError(f"I{category:03d}/{name}: {len(item)} bytes, must be {rule.size}")
        body += item
    return bytes(selection + body)


def blocks(category: int, records: Iterable[bytes], most: int = MAX_BLOCK) -> list[bytes]:
    """Return data blocks of at most so many bytes, with the records in order."""
    found: list[bytes] = []
    body = b""
    for each in records:
        if body and len(body) + len(each) + 3 > most:
            found.append(_block(category, body))
            body = b""
        body += each
    return [*found, _block(category, body)] if body else found


def _block(category: int, body: bytes) -> bytes:
    return bytes([category]) + (len(body) + 3).to_bytes(2, "big") + body


def unsigned(value: float, unit: float, size: int) -> bytes:
    """Return a number in whole units, at most as large as its bytes allow."""
    most: int = 256**size - 1
    # Bounded first: what is beyond all bounds, or infinite by now, has no whole number.
    return round(min(max(value / unit, 0), most)).to_bytes(size, "big")


def signed(value: float, unit: float, size: int) -> bytes:
    """Return a number with its sign in whole units, at most as large as its bytes allow."""
    half: int = 256**size // 2
    return round(min(max(value / unit, -half), half - 1)).to_bytes(size, "big", signed=True)


def time_of_day(time_ns: int) -> bytes:
    """Return a time since the epoch as time of day in three bytes."""
    return (round(time_ns / NS_PER_TICK) % DAY).to_bytes(3, "big")
