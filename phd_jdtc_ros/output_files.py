"""Files of results: checked before the work begins, and written whole or not at all.

A node that runs for months replaces only files of its own kind. No pipe is waited for.
"""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from phd_jdtc_ros.configuration.schema import ConfigError

# Files are readable by others; a temporary file is readable by its owner only.
MODE = 0o644
_KINDS = {
    stat.S_IFDIR: "a directory",
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def write(path: Path, data: str | bytes) -> None:
    """Write a file through a temporary one beside it, so that it is never incomplete.

    A symbolic link is replaced, and its target stays as it is. A path that is not a regular file,
    such as ``/dev/stdout``, is written to directly. An `OSError` has the path as its ``filename``;
    no file is left then.
    """
    content = data.encode() if isinstance(data, str) else data
    if path.exists() and not path.is_file():
        with opened(path) as stream:
            stream.write(content)
        return
    temporary = None
    try:
        descriptor, temporary = tempfile.mkstemp(".tmp", f".{path.name}.", path.parent)
        with open(descriptor, "wb") as file:
            file.write(content)
        os.chmod(temporary, MODE)
        os.replace(temporary, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file for writing in parts; an `OSError` has its path as its ``filename``.

    A pipe that no program reads is such an error.
    """
    try:
        with open(path, "wb", opener=_open_at_once) as stream:
            yield stream
    except OSError as error:
        unread = "no program reads this pipe" if error.errno == errno.ENXIO else error.strerror
        raise OSError(error.errno, unread, error.filename or str(path)) from error


def _open_at_once(path: str, flags: int) -> int:
    """Open a path as `open` does, but without waiting for the reader of a pipe."""
    descriptor = os.open(path, flags | os.O_NONBLOCK, 0o666)
    os.set_blocking(descriptor, True)
    return descriptor


def require_replaceable(path: Path, kind: str, begin: bytes) -> None:
    """Check that at a path is nothing, or a file of a kind, which begins with these bytes.

    A link is not followed, and nothing but a file is opened. Raise `OSError` with what is there.
    """
    try:
        mode = stat.S_IFMT(path.lstat().st_mode)
    except FileNotFoundError:
        return
    found = _KINDS.get(mode, f"a file that is no {kind}")
    if mode == stat.S_IFREG:
        with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            if file.read(len(begin)) == begin:
                return
    raise FileExistsError(errno.EEXIST, f"{found} is there, only a {kind} is replaced", str(path))


def why_closed(directory: Path, *, parents: bool = False) -> str:
    """Return in words why no file can be made in a directory, with its path; empty if one can.

    With `parents` the directory need not exist, nor those above it, but it must be possible to make
    them. A file is made, because permissions alone do not tell what a file system takes.
    """
    while parents and not os.path.lexists(directory) and directory != directory.parent:
        directory = directory.parent
    # Without permission pathlib raises, and os.path returns False.
    if not os.path.isdir(directory):
        is_what = "is a file, must be a" if os.path.exists(directory) else "is no"
        return f"{directory} {is_what} directory"
    try:
        with tempfile.TemporaryFile(dir=directory):
            return ""
    except OSError as error:
        return f"{directory} cannot be written to: {error.strerror}"


def require_new(paths: Mapping[str, Path | None], made: Path | None = None) -> None:
    """Check that files, by the option that asks for each, can be written when they are ready.

    An option that is not given is None, and `made` a directory that will have been made by then.
    `ConfigError` lists every file that exists, that has the path of another one, or whose directory
    does not exist or takes no files.
    """
    faults = []
    options: dict[Path, str] = {} if made is None else {made.resolve(): "--out"}
    for option, path in paths.items():
        if path is None:
            continue
        whole = path.resolve()
        if whole in options:
            faults.append(f"{option}: {path} given, {options[whole]} has it too")
        elif path.is_file() or (path.is_symlink() and not path.exists()):
            faults.append(f"{option}: {path} already exists, a file is not overwritten")
        elif path.is_dir():
            faults.append(f"{option}: {path} given, must be a file, is a directory")
        elif whole.parent != (made and made.resolve()) and (lack := why_closed(whole.parent)):
            faults.append(f"{option}: {path} given, but {lack}")
        options.setdefault(whole, option)
    if faults:
        raise ConfigError(*faults)
