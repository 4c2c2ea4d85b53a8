"""Encodes items as records and data blocks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ..clocks import NS_PER_TICK
from ..item_rules import Fixed
from ..messages import DAY
from ..specification import layouts

# Largest datagram, bytes, that passes common networks unfragmented.
MAX_BLOCK = 1400


def record(category: int, items: Mapping[str, bytes], kind: str = "") -> bytes:
    """Return a record: the selection of its items (FSPEC), then the items in the category's order.

    Raise `ValueError` if an item of fixed length has a different length.
    """
    layout = layouts(category)[kind]
    places = sorted(layout.place[name] for name in items)
    selection = bytearray(b"\1" * (places[-1] // 7) + b"\0")
    body = bytearray()
    for place in places:
        selection[place // 7] |= 0x80 >> place % 7
        name, rule = layout.names[place], layout.rules[place]
        item = items[name or ""]
        if isinstance(rule, Fixed) and len(item) != rule.size:
            raise ValueError(f"I{category:03d}/{name}: {len(item)} bytes, must be {rule.size}")
        body += item
    return bytes(selection + body)


def blocks(category: int, records: Iterable[bytes]) -> list[bytes]:
    """Return data blocks of at most `MAX_BLOCK` bytes with the records in order."""
    found: list[bytes] = []
    body = b""
    for each in records:
        if body and len(body) + len(each) + 3 > MAX_BLOCK:
            found.append(_block(category, body))
            body = b""
        body += each
    return [*found, _block(category, body)] if body else found


def _block(category: int, body: bytes) -> bytes:
    return bytes([category]) + (len(body) + 3).to_bytes(2, "big") + body


def unsigned(value: float, unit: float, size: int) -> bytes:
    """Encode a number in whole units, limited to the range of its bytes."""
    most: int = 256**size - 1
    # The limit is applied first, because infinity cannot be rounded.
    return round(min(max(value / unit, 0), most)).to_bytes(size, "big")


def signed(value: float, unit: float, size: int) -> bytes:
    """Encode a signed number in whole units, limited to the range of its bytes."""
    half: int = 256**size // 2
    return round(min(max(value / unit, -half), half - 1)).to_bytes(size, "big", signed=True)


def time_of_day(time_ns: int) -> bytes:
    """Encode a time since the epoch as a time of day in three bytes."""
    return (round(time_ns / NS_PER_TICK) % DAY).to_bytes(3, "big")
