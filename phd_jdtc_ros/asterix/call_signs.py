"""Keeps the call sign of each aircraft by its Mode S address, as a name only."""

from __future__ import annotations

from .messages import NONE

# A call sign has CHARACTERS of BITS bits each: letters from 1, a space, and digits.
CHARACTERS, BITS = 8, 6
_VALID = frozenset((*range(1, 27), 32, *range(48, 58)))
_SPACE = 32
# Upper bound of the call signs kept; the least recent ones are dropped.
MOST = 10_000


def read(data: bytes, at: int) -> int:
    """Return a call sign as its 48 bits, `NONE` if it is absent, blank or garbled."""
    if at < 0:
        return NONE
    found = int.from_bytes(data[at : at + CHARACTERS * BITS // 8], "big")
    parts = {found >> BITS * place & 63 for place in range(CHARACTERS)}
    return found if parts <= _VALID and parts != {_SPACE} else NONE


def text(call_sign: int) -> str:
    """Return a call sign's letters and digits; empty for `NONE`."""
    if call_sign == NONE:
        return ""
    places = range(CHARACTERS * BITS - BITS, -1, -BITS)
    letters = (call_sign >> place & 63 for place in places)
    return "".join(chr(each + 64 * (each <= 26)) for each in letters).strip()


class CallSigns:
    """The latest call sign of each address."""

    def __init__(self) -> None:
        self._by_address: dict[int, int] = {}

    def take(self, address: int, call_sign: int) -> None:
        """Add the call sign and the address of one plot; either may be `NONE`."""
        if address == NONE or call_sign == NONE:
            return
        self._by_address.pop(address, None)
        self._by_address[address] = call_sign
        if len(self._by_address) > MOST:
            del self._by_address[next(iter(self._by_address))]

    def of(self, address: int) -> int:
        """Return the call sign of an address, `NONE` if unknown."""
        return self._by_address.get(address, NONE)
