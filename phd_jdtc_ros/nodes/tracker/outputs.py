"""The publishers of the tracker, as the table in `msg_adapters.outputs` has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rclpy.lifecycle import LifecycleNode

from msg_adapters import interfaces
from msg_adapters.outputs import Output, View, table
from msg_adapters.trails import Trails
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.configuration.tracker_node import Settings

from . import endpoints
from .health import OutputHealth

# Positions of a track in ~/tracks/path and ~/tracks/geojson: some ten minutes of a turning radar.
PATH_LENGTH = 100


def _is_wanted(row: Output, values: Mapping[str, Any]) -> bool:
    """Return whether an output is wanted by the node's parameters."""
    return not row.switch or row.switch in values["outputs"]


class Outputs:
    """The tracker's publishers; silent while the node is not active.

    Parameters
    ----------
    health : OutputHealth
        Counts subscriptions with an incompatible QoS.

    Raises
    ------
    ConfigError
        If an output's QoS override is not valid, or its message package is not installed.
    """

    def __init__(self, node: LifecycleNode, settings: Settings, health: OutputHealth) -> None:
        self._node, self._health = node, health
        self._values = settings.node
        config = settings.config
        names = tuple(c.name for c in config.model.modes.classes)
        trails = Trails(PATH_LENGTH)
        self._view = View(config.world_frame, names, config.model.radars, config.plane, trails)
        self._publishers: dict[Output, Any] = {}
        # Stamps of the last messages of what is published now and then.
        self._last_ns: dict[Output, int] = {}
        try:
            for row in table(len(names), config.engine):
                # One that may be switched on later has its publisher from the start.
                if row.needs(self._view) and (row.clear or _is_wanted(row, self._values)):
                    self._publishers[row] = self._publisher(row)
        except Exception:
            self.destroy()
            raise

    def _publisher(self, row: Output) -> Any:
        try:
            kind = interfaces.message_class(row.type_name)
        except ImportError as error:
            text = f"outputs: {row.switch} given, but its message package is not installed"
            raise ConfigError([text]) from error
        qos = endpoints.latched_qos() if row.latched else endpoints.output_qos()
        return endpoints.publisher(self._node, kind, row.topic, qos, self._health)

    def destroy(self) -> None:
        """Destroy all publishers."""
        while self._publishers:
            self._node.destroy_lifecycle_publisher(self._publishers.popitem()[1])

    def begin_run(self) -> None:
        """Begin a new run."""
        self._view.begin_run()
        self._last_ns.clear()

    def retune(self, settings: Settings) -> None:
        """Publish what changed parameters ask for, and remove what is no longer shown."""
        gone = [row for row in self._publishers if not _is_wanted(row, settings.node)]
        self._clear(gone)
        self._values = settings.node

    def clear(self) -> None:
        """Remove what is shown; such a topic is latched, so late joiners would get it."""
        self._clear(list(self._publishers))

    def _clear(self, rows: list[Output]) -> None:
        for row in rows:
            if row.clear and _is_wanted(row, self._values):
                self._publishers[row].publish(row.clear(self._view))

    def publish(self, when: str, stamp_ns: int, what: Any) -> None:
        """Publish what has happened on all topics that show it.

        Parameters
        ----------
        when : str
            See `Output`.
        """
        for row, publisher in self._publishers.items():
            if row.when != when or not _is_wanted(row, self._values):
                continue
            last_ns = self._last_ns.get(row)
            if last_ns is not None and stamp_ns - last_ns < row.period_s * 1e9:
                continue
            for message in row.encode(what, self._view):
                publisher.publish(message)
                if row.period_s:
                    self._last_ns[row] = stamp_ns
