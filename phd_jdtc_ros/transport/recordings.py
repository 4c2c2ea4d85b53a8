"""Opens recordings, which gzip may have packed, and moves their times to a day."""

from __future__ import annotations

import gzip
import mmap
import tempfile
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from .network import Datagram, RecordingError

NS_PER_DAY = 86_400 * 10**9
_GZIP = b"\x1f\x8b\x08"
# Upper bound of an unpacked recording, bytes, so that a small file does not fill the disk.
LARGEST_UNPACKED, CHUNK = 2**35, 2**20


@contextmanager
def open_recording(path: Path, counts: Counter[str]) -> Iterator[bytes | mmap.mmap]:
    """Open a file as bytes that are read from the disk on demand; raise `OSError` if unreadable.

    A file that gzip has packed is unpacked to a temporary file. If it is damaged, `counts` gains
    ``unpacking_ended``, and the bytes before the damage are used. Raise `RecordingError` if it is
    larger than `LARGEST_UNPACKED`.
    """
    with path.open("rb") as stream, tempfile.TemporaryFile() as unpacked:
        source: IO[bytes] = stream
        if stream.read(len(_GZIP)) == _GZIP:
            stream.seek(0)
            _unpack(stream, unpacked, counts)
            source = unpacked
        if not source.seek(0, 2):
            yield b""
            return
        with mmap.mmap(source.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield data


def _unpack(packed: IO[bytes], unpacked: IO[bytes], counts: Counter[str]) -> None:
    try:
        with gzip.GzipFile(fileobj=packed) as stream:
            while part := stream.read1(CHUNK):
                if unpacked.tell() + len(part) > LARGEST_UNPACKED:
                    raise RecordingError(
                        f"is larger than {LARGEST_UNPACKED >> 30} GiB when gzip has unpacked it"
                    )
                unpacked.write(part)
    except (EOFError, gzip.BadGzipFile, zlib.error):
        counts["unpacking_ended"] += 1
    unpacked.flush()


def on_day(found: Iterator[Datagram], midnight_ns: int | None) -> Iterator[Datagram]:
    """Yield datagrams moved by whole days, so that the first is on the given day."""
    shift_ns: int | None = None
    for each in found:
        if midnight_ns is None or each.received_ns is None:
            yield each
            continue
        if shift_ns is None:
            shift_ns = midnight_ns - each.received_ns // NS_PER_DAY * NS_PER_DAY
        yield each._replace(received_ns=each.received_ns + shift_ns)
