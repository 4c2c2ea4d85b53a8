"""Files of results: checked before the work begins, and written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from phd_jdtc_ros.configuration.schema import ConfigError

# Files are readable by others; a temporary file is readable by its owner only.
MODE = 0o644


def write(path: Path, data: str | bytes) -> None:
    """Write a file through a temporary one beside it, so that it is never incomplete.

    A symbolic link is replaced, and its target stays as it is. A path that is not a regular file,
    such as ``/dev/stdout``, is written to directly. An `OSError` has the path as its ``filename``;
    no file is left then.
    """
    content = data.encode() if isinstance(data, str) else data
    if path.exists() and not path.is_file():
        path.write_bytes(content)
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
    """Open a file for writing in parts; an `OSError` has its path as its ``filename``."""
    try:
        with path.open("wb") as stream:
            yield stream
    except OSError as error:
        raise OSError(error.errno, error.strerror, error.filename or str(path)) from error


def require_new(paths: Mapping[str, Path | None], made: Path | None = None) -> None:
    """Check that files, by the option that asks for each, can be written when they are ready.

    An option that is not given is None, and `made` a directory that will have been made by then.
    `ConfigError` lists every file that exists, that has the path of another one, or whose directory
    does not exist.
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
        elif whole.parent != (made and made.resolve()) and not os.access(whole.parent, os.W_OK):
            lacks = "cannot be written to" if whole.parent.is_dir() else "is no directory"
            faults.append(f"{option}: {path} given, but {whole.parent} {lacks}")
        options.setdefault(whole, option)
    if faults:
        raise ConfigError(*faults)
