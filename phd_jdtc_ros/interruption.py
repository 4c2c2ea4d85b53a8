"""Interruption of the offline executables by SIGINT, and by the SIGTERM of a service manager."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class _Steps:
    """The nested steps that the main thread is in, and whether an interruption waits for them."""

    nested = 0
    interrupted = False


@contextmanager
def accepted() -> Iterator[None]:
    """Raise `KeyboardInterrupt` in the main thread on a signal, after the step that it is in."""
    signals = (signal.SIGINT, signal.SIGTERM)
    # Other threads can have no handlers.
    numbers = signals if _is_main_thread() else ()
    before = {number: signal.signal(number, _interrupt) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def step() -> Iterator[None]:
    """Let an interruption wait for the end of the block, which leaves no file half written."""
    if not _is_main_thread():
        yield
        return
    _Steps.nested += 1
    try:
        yield
    finally:
        _Steps.nested -= 1
        if _Steps.interrupted and not _Steps.nested:
            _raise()


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _Steps.nested:
        _Steps.interrupted = True
    else:
        _raise()


def _raise() -> None:
    _Steps.interrupted = False
    raise KeyboardInterrupt


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
