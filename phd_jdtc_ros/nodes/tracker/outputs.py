"""The publishers of the tracker, by the tables in `msg_adapters.outgoing.outputs`.

Messages are encoded only if there are subscribers. The last message of a latched topic is encoded
when the first subscriber joins.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.lifecycle import LifecycleNode

from msg_adapters.encoding import interfaces, names
from msg_adapters.outgoing import map_layers
from msg_adapters.outgoing.map_layers import Mounting
from msg_adapters.outgoing.outputs import Output, View, table
from msg_adapters.targets.tracks import Trails
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.core.types import FILTERED, Pose

from ..common import topics
from . import endpoints
from .health import OutputHealth
from .senders import Link, Senders
from .settings import Settings

# Positions of a track in ~/tracks/path and ~/tracks/geojson: some ten minutes of a turning radar.
PATH_LENGTH = 100
DEPTH, LATCHED_DEPTH = 10, 1


def _is_wanted(row: Output, values: Mapping[str, Any]) -> bool:
    """Return whether an output is wanted by the node's parameters."""
    return not row.switch or row.switch in values["outputs"]


class Outputs:
    """The tracker's publishers; silent while the node is not active."""

    def __init__(
        self,
        node: LifecycleNode,
        settings: Settings,
        health: OutputHealth,
        own_pose: Callable[[int], Pose | None],
        manual: Callable[[], Manual],
    ) -> None:
        self._node, self._health = node, health
        self._values = settings.node
        config = settings.config
        classes = tuple(c.name for c in config.model.modes.classes)
        trails = Trails(PATH_LENGTH)
        self._view = View(
            config.world_frame,
            classes,
            config.model.radars,
            config.plane,
            trails,
            config.model.has_clutter_map,
            zones=config.conflicts.zones if config.conflicts.enabled else None,
            own_pose=own_pose,
            manual=manual,
            types=self._values["cot_types"],
            stale_s=config.reset_threshold_s,
        )
        self._senders = Senders(self._values)
        self._publishers: dict[Output, Any] = {}
        # The outputs that are wanted, with their publishers, by trigger.
        self._wanted: dict[str, list[tuple[Output, Any]]] = {}
        self._frames: Any = None
        # Stamps of the last messages of periodic outputs.
        self._last_ns: dict[Output, int] = {}
        # Stamp and data of the last message of a latched topic, until the message is published.
        self._unsent: dict[Output, tuple[int, Any]] = {}
        try:
            for row in table(len(classes), config.engine):
                # An output that may be switched on later has its publisher from the start.
                if row.needs(self._view) and (row.clear or _is_wanted(row, self._values)):
                    self._publishers[row] = self._publisher(row)
        except Exception:
            self.destroy()
            raise
        self._select_wanted()
        if "frames" in self._values["outputs"]:
            self._frames = self._publish_frames(settings)

    def _publisher(self, row: Output) -> Any:
        kind = interfaces.installed_class(row.type_name)
        if kind is None:
            text = f"outputs: {row.switch} given, but its message package is not installed"
            raise ConfigError(text)
        qos = topics.latched(LATCHED_DEPTH) if row.latched else topics.reliable(DEPTH)
        on_subscriber = partial(self._send, row) if row.latched else None
        return endpoints.publisher(self._node, kind, row.topic, qos, self._health, on_subscriber)

    def _publish_frames(self, settings: Settings) -> Any:
        """Publish the fixed radars' poses once; return the publisher, None without tf2_msgs."""
        kind = interfaces.installed_class(names.TRANSFORMS)
        if kind is None:
            self._node.get_logger().info(
                "tf2_msgs is not installed: the radars' frames are not published on "
                f"{names.STATIC_FRAMES}; ~/detections needs none of them",
                once=True,
            )
            return None
        config = settings.config
        mountings = [
            Mounting(source.frame, model.position, model.yaw)
            for source, model in zip(config.inputs, config.model.radars, strict=True)
            if not source.pose.topic
        ]
        qos = topics.latched(LATCHED_DEPTH)
        publisher = self._node.create_publisher(kind, names.STATIC_FRAMES, qos)
        stamp_ns = self._node.get_clock().now().nanoseconds
        publisher.publish(map_layers.frames_to_cdr(mountings, stamp_ns, config.world_frame))
        return publisher

    def destroy(self) -> None:
        """Destroy all publishers, and close all connections."""
        self._senders.close()
        while self._publishers:
            self._node.destroy_lifecycle_publisher(self._publishers.popitem()[1])
        if self._frames is not None:
            self._node.destroy_publisher(self._frames)
            self._frames = None

    @property
    def links(self) -> list[Link]:
        """The links to the destinations of streams."""
        return self._senders.links

    def begin_run(self) -> None:
        """Begin a new run; latched topics keep the end of the last, even without subscribers."""
        for row in list(self._unsent):
            self._send(row)
        self._view.begin_run()
        self._last_ns.clear()

    def retune(self, settings: Settings) -> None:
        """Follow changed parameters: clear the outputs that are no longer wanted."""
        self._clear([row for row in self._publishers if not _is_wanted(row, settings.node)])
        self._values = settings.node
        self._select_wanted()

    def _select_wanted(self) -> None:
        self._wanted = {}
        for row, publisher in self._publishers.items():
            if _is_wanted(row, self._values):
                self._wanted.setdefault(row.when, []).append((row, publisher))

    def clear(self) -> None:
        """Clear all displays: their topics are latched, and would show old data to late ones."""
        self._clear(list(self._publishers))

    def _clear(self, rows: list[Output]) -> None:
        for row in rows:
            if row.clear and _is_wanted(row, self._values):
                self._unsent.pop(row, None)
                self._publishers[row].publish(row.clear(self._view))

    def publish(self, when: str, stamp_ns: int, data: Any) -> None:
        """Publish data on all topics with this trigger, see `Output.when`; send streams."""
        if when == FILTERED:
            self._senders.send(data, self._view)
        for row, publisher in self._wanted.get(when, ()):
            last_ns = self._last_ns.get(row)
            if last_ns is not None and stamp_ns - last_ns < row.period_s * 1e9:
                continue
            if row.latched:
                self._unsent[row] = stamp_ns, data
            if not publisher.get_subscription_count():
                if row.remembers:
                    row.encode(data, self._view)
            elif row.latched:
                self._send(row)
            else:
                self._encode(row, stamp_ns, data)

    def _send(self, row: Output) -> None:
        """Publish the last message of a latched topic, unless it has been published."""
        if row in self._unsent:
            self._encode(row, *self._unsent.pop(row))

    def _encode(self, row: Output, stamp_ns: int, data: Any) -> None:
        try:
            messages = row.encode(data, self._view)
        except AttributeError as error:
            if row.usual:
                raise
            # The installed messages lack a field.
            text = f"outputs: {row.switch} is left out, its message package is of another version"
            self._node.get_logger().error(f"{text}: {error}")
            self._node.destroy_lifecycle_publisher(self._publishers.pop(row))
            self._select_wanted()
            return
        for message in messages:
            self._publishers[row].publish(message)
            if row.period_s:
                self._last_ns[row] = stamp_ns
