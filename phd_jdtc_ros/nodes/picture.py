"""Shows a tracker's live picture in a browser: tracks, detections, alarms and health.

A node that only subscribes. It encodes what is new four times a second, if anybody looks.
"""

from __future__ import annotations

import argparse
import json
import secrets
import socket
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import RejectedMessageError, interfaces, names, point_cloud
from msg_adapters.incoming import moving_radars
from msg_adapters.incoming.moving_radars import MovingRadars
from msg_adapters.outgoing import conflicts
from msg_adapters.targets import estimates
from phd_jdtc_ros.configuration import zones
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import STATIC_TRANSFORMS
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.models.zones import Zone
from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.parameter_files.from_arguments import config_of
from phd_jdtc_ros.report.page import words
from phd_jdtc_ros.report.page.layers import AMPLITUDE_SCALES
from phd_jdtc_ros.report.page.picture import zone_lines

from . import picture_server as server
from .common import parameters, runtime, topics
from .common.health import ThrottledWarnings
from .common.parameters import TrackerParameters
from .common.runtime import RunnableNode
from .picture_server import Server, is_loopback

BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
# Numbers of detections that are shown, and of clouds that are kept until they are encoded.
MOST_PLOTS, MOST_CLOUDS = 5000, 100


def page(tracker: str, head: Mapping[str, Any]) -> str:
    """Return the page for a tracker's name and what `picture_server.head` returns."""
    assets = files("phd_jdtc_ros.report.page") / "assets"
    scripts = ("drawing.js", "picture.js", "live.js")
    part = {name: (assets / name).read_text("utf-8") for name in ("page.css", *scripts)}
    run = {"picture": head, "amplitude_scales": AMPLITUDE_SCALES}
    text = json.dumps(run, allow_nan=False).replace("<", "\\u003c")
    return Template((assets / "live.html").read_text("utf-8")).substitute(
        title=escape(tracker),
        style=part["page.css"],
        picture=words.section(head),
        run=text,
        script="".join(part[name] for name in scripts),
    )


class Picture(RunnableNode):
    """Subscribes to a tracker's topics, and serves what has come last."""

    DEPTH = 10

    def __init__(self, given: argparse.Namespace) -> None:
        super().__init__("picture")
        self._tracker, self._lock = given.tracker, threading.Lock()
        self._latest: dict[str, Any] = {}  # Newest message of each kind that was not yet encoded
        self._plots: deque[PointCloud2] = deque(maxlen=MOST_CLOUDS)
        self._sent: dict[str, bytes] = {}  # Newest event of each kind
        self._head = server.head({})
        self._zones: Sequence[Zone] = ()
        self._encoders: dict[str, Callable[[Any], Mapping[str, Any]]] = {
            "head": dict,
            "carriers": server.of_carriers,
            "tracks": lambda cloud: server.of_tracks(estimates.from_msg(cloud)),
            "alarms": lambda cloud: server.of_alarms(conflicts.from_msg(cloud), self._zones),
            "plots": _plots,
            "health": _health,
        }
        self._warnings = ThrottledWarnings(self.get_logger())
        for kind, message_type, topic in (
            ("tracks", PointCloud2, names.estimates(FILTERED, self._tracker)),
            ("alarms", PointCloud2, names.conflicts(self._tracker)),
            ("health", DiagnosticArray, names.DIAGNOSTICS),
        ):
            self._subscribe(message_type, topic, self._keeper(kind))
        plots = names.detections_in_map(self._tracker)
        self._subscribe(PointCloud2, plots, self._keep_plots)
        TrackerParameters(self, self._tracker, self._on_parameters)
        token = given.token or ("" if is_loopback(given.host) else secrets.token_urlsafe(16))
        self.server = Server(given.host, given.port, token, self._page, self._first, self._take)
        query = f"?token={token}" if token else ""
        # The link can be followed, also where the address is that of all networks.
        everywhere = socket.gethostname() if given.host in ("0.0.0.0", "::") else given.host
        host = "localhost" if is_loopback(given.host) else everywhere
        self.get_logger().info(f"look at http://{host}:{self.server.port}/{query}")

    def _subscribe(self, kind: type, topic: str, callback: Callable[[Any], None]) -> None:
        topics.subscribe(self, kind, topic, callback, self.DEPTH, "tracker", self._tracker)

    def _keeper(self, kind: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            own = kind != "health" or any(
                status.name.startswith(f"{self._tracker}: ") for status in message.status
            )
            if own:
                with self._lock:
                    self._latest[kind] = message

        return keep

    def _keep_plots(self, cloud: PointCloud2) -> None:
        if self.server.clients:  # Detections of before are not shown
            self._plots.append(cloud)

    def _on_parameters(self, values: dict[str, Any]) -> None:
        """Learn the names of the classes, and the places of the radars and the zones."""
        found = server.head(values)
        try:
            if "sensors" in values:  # `hand_over` has none
                config = config_of({**values, "zones": ""})
                sensors = zip(config.inputs, config.model.radars, strict=True)
                found["sites"] = [
                    [own.name, *sensor.position] for own, sensor in sensors if not own.pose.topic
                ]
                self._follow(config)
                self._zones = zones.read(values.get("zones", ""), config.plane)
        except ConfigError as error:  # A file of zones may be on another machine
            self.get_logger().warning(f"zones or moving radars are not shown: {error}")
        self._head = {**found, "zones": zone_lines(self._zones)}
        with self._lock:
            self._latest["head"] = self._head

    def _follow(self, config: TrackerConfig) -> None:
        """Subscribe to the poses of moving radars."""
        moving, places = MovingRadars(config), dict[int, tuple[float, float]]()

        def take(topic: str, data: bytes) -> None:
            try:
                poses, _ = moving.read(topic, data)
            except RejectedMessageError as error:
                self._warnings.warn(topic, f"{topic}: {error}")
                return
            places.update((known.radar, known.pose.position) for known in poses)
            with self._lock:
                self._latest["carriers"] = dict(places)

        for topic, name in moving_radars.types_of(config).items():
            kind = interfaces.installed_class(name)
            # As the tracker asks for them.
            qos = topics.latched(self.DEPTH) if topic == STATIC_TRANSFORMS else BEST_EFFORT
            if kind is not None:
                self.create_subscription(kind, topic, partial(take, topic), qos, raw=True)

    def _page(self) -> str:
        return page(self._tracker, self._head)

    def _first(self) -> Mapping[str, bytes]:
        return self._sent

    def _take(self) -> Mapping[str, bytes]:
        """Return the events of what is new, by kind; called in the server's thread."""
        with self._lock:
            latest, self._latest = self._latest, {}
        plots = [self._plots.popleft() for _ in range(len(self._plots))]
        found: dict[str, bytes] = {}
        for kind, message in (*latest.items(), *([("plots", plots)] if plots else [])):
            try:
                found[kind] = server.event(kind, self._encoders[kind](message))
            except RejectedMessageError as error:
                self._warnings.warn(kind, f"{kind}: {error}")
        self._sent = {**self._sent, **found}
        return found

    def close(self) -> None:
        """End the server."""
        self.server.close()


def _health(message: DiagnosticArray) -> dict[str, Any]:
    worst = max(message.status, key=lambda status: status.level)
    return {"level": int.from_bytes(worst.level, "little"), "text": worst.message}


def _plots(clouds: Sequence[PointCloud2]) -> dict[str, Any]:
    wanted = {"x": point_cloud.FLOATS, "y": point_cloud.FLOATS, "radar_index": point_cloud.UNSIGNED}
    parts = [point_cloud.decode(cloud, wanted) for cloud in clouds]
    for part in parts:
        point_cloud.require_finite({name: part[name] for name in ("x", "y")})
    joined = (np.concatenate([part[name] for part in parts])[-MOST_PLOTS:] for name in wanted)
    return server.of_plots(*joined)


def main(argv: Sequence[str]) -> int:
    """Run the node."""
    parser = ArgumentParser("picture", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--tracker", default=names.TRACKER, help="full name (%(default)s)")
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to serve at (%(default)s); any but this machine's own is asked for a token",
    )
    parser.add_argument("--port", type=int, default=8321, help="%(default)s; 0 for a free one")
    parser.add_argument("--token", default="", help="token to ask for, instead of a random one")
    others, _ = parameters.split("picture", argv)
    given = parser.parse_args(others)
    return runtime.run("picture", lambda: Picture(given), argv)
