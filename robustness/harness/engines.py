"""The engine of the trackers under test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace

from phd_jdtc_ros.configuration.engines import ENGINES

from .figures import Figure

PARTICLES, GAUSSIAN = "particles", "gaussian"
ALL = tuple(ENGINES)
_chosen: ContextVar[str] = ContextVar("engine", default=PARTICLES)


def current() -> str:
    """Return the engine of the trackers that are started now."""
    return _chosen.get()


@contextmanager
def using(engine: str) -> Iterator[None]:
    """Start trackers with this engine for as long as the block lasts."""
    if engine not in ALL:
        raise ValueError(f"engine: {engine!r} given, must be one of {', '.join(ALL)}")
    token = _chosen.set(engine)
    try:
        yield
    finally:
        _chosen.reset(token)


def arguments() -> tuple[str, ...]:
    """Return a tracker's arguments that choose the engine."""
    return "--ros-args", "-p", f"engine:={current()}"


def of(engine: str, measure: Callable[[], Figure]) -> Callable[[], Figure]:
    """Return a measurement with this engine; its figure is named after it."""

    def measured() -> Figure:
        with using(engine):
            figure = measure()
        return replace(figure, name=f"{engine}: {figure.name}")

    return measured
