"""How a launch ends with another status than 0, which it does for an exception alone."""

from __future__ import annotations

from launch.actions import OpaqueFunction, RegisterEventHandler

from launch import Event, EventHandler, LaunchContext


class Failure(Event):
    """A node has failed: the launch shuts down with status 1.

    As an event, so that others learn of the node's end before.
    """

    name = "phd_jdtc_ros.Failure"

    def __init__(self, reason: str) -> None:
        self.reason = reason


def watched() -> RegisterEventHandler:
    """Return the action that lets failures end the launch."""
    return RegisterEventHandler(
        EventHandler(
            matcher=lambda event: isinstance(event, Failure),
            entities=[OpaqueFunction(function=_end)],
        )
    )


def _end(context: LaunchContext) -> None:
    raise RuntimeError(context.locals.event.reason)
