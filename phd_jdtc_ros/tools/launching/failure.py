"""A failed node ends its launch with status 1: only an exception gives a launch another status."""

from __future__ import annotations

from launch.actions import OpaqueFunction, RegisterEventHandler

from launch import Event, EventHandler, LaunchContext


class Failure(Event):
    """A node has failed: the launch shuts down with status 1.

    It is an event, so that other handlers are informed of the node's end first.
    """

    name = "phd_jdtc_ros.Failure"

    def __init__(self, reason: str) -> None:
        self.reason = reason


def handler() -> RegisterEventHandler:
    """Return the action that ends the launch at a failure."""
    return RegisterEventHandler(
        EventHandler(
            matcher=lambda event: isinstance(event, Failure),
            entities=[OpaqueFunction(function=_end)],
        )
    )


def _end(context: LaunchContext) -> None:
    raise RuntimeError(context.locals.event.reason)
