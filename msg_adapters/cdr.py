# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""CDR by hand, for messages of thousands of parts.

A message object costs rclpy about five microseconds to make and one to send, and the markers of
200 estimates are made of 8000. A publisher takes a serialised message as well, and that one numpy
can fill in as a whole: a `Writer` lays out a record once; it is then repeated and filled in.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .stamps import NS_PER_S

# Plain CDR, little-endian; alignment is counted from behind these bytes.
ENCAPSULATION = b"\x00\x01\x00\x00"
LARGEST_ALIGNMENT = 8


@dataclass
class Writer:
    """Members one after the other, each aligned to its own size, padded with zeros.

    Parameters
    ----------
    start : int
        Where the first byte will stand in the message.
    """

    start: int = 0
    data: bytearray = field(default_factory=bytearray)

    def put(self, code: str, *values: float) -> int:
        """Append numbers of one `struct` code; return where the first stands in `data`."""
        self.data += bytes(-(self.start + len(self.data)) % struct.calcsize(code))
        offset = len(self.data)
        self.data += struct.pack(f"<{len(values)}{code}", *values)
        return offset

    def string(self, text: str) -> int:
        """Append a string; return where its first character stands in `data`."""
        encoded = text.encode()
        self.put("I", len(encoded) + 1)
        self.data += encoded + b"\0"
        return len(self.data) - len(encoded) - 1

    def header(self, stamp_ns: int, frame: str) -> int:
        """Append a ``std_msgs/Header``; return where its stamp stands in `data`."""
        sec, nanosec = divmod(stamp_ns, NS_PER_S)
        offset = self.put("i", sec)
        self.put("I", nanosec)
        self.string(frame)
        return offset


@dataclass(frozen=True, eq=False)
class Record:
    """A laid out record, and the members of it that are yet to be filled in.

    Parameters
    ----------
    data : bytes
    members : numpy.dtype
        Structured, as long as `data`.
    """

    data: bytes
    members: np.dtype[np.void]

    def repeated(self, count: int) -> npt.NDArray[np.void]:
        """Return `count` copies, writable by member."""
        return np.frombuffer(bytearray(self.data * count), dtype=self.members)


def layout(members: Mapping[str, tuple[str, int]], size: int) -> np.dtype[np.void]:
    """Return the type of a record of `size` bytes from its members' types and offsets."""
    return np.dtype(
        {
            "names": list(members),
            "formats": [kind for kind, _ in members.values()],
            "offsets": [offset for _, offset in members.values()],
            "itemsize": size,
        }
    )
