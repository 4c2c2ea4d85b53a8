"""The publishers of the tracker: detections, estimates, poses, markers, tracks, figures, plots."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import NavSatFix, PointCloud2
from std_msgs.msg import Float64
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters import (
    clutter_maps,
    detections_in_map,
    diagnostics,
    estimates,
    geo_json,
    geodetic,
    markers,
    navsat,
    plots,
    poses,
    quantities,
    radar_tracks,
    stamps,
    tracks,
    vision,
)
from msg_adapters.tracks import Waypoint
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.configuration.tracker_node import Settings
from phd_jdtc_ros.core.engine import Engine, Step
from phd_jdtc_ros.core.types import FILTERED, SOURCES, Estimates, Scan

from . import endpoints
from .health import OutputHealth

# A path is continued if its track is estimated again after at most this many scans.
UNSEEN_SCANS = 10
# The picture of clutter is published so often, seconds by the scans' stamps.
CLUTTER_PERIOD_S = 10.0
# Positions of a track in ~/tracks/path and ~/tracks/geojson: some ten minutes of a turning radar.
PATH_LENGTH = 100


class Trails:
    """The latest positions of every track with an estimate in the last `UNSEEN_SCANS` scans.

    Parameters
    ----------
    length : int
        Number of positions kept per track.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._trails: dict[int, deque[Waypoint]] = {}
        self._unseen: dict[int, int] = {}

    def add(self, found: Estimates) -> list[deque[Waypoint]]:
        """Add a scan's estimates; return the trails of their tracks, by ascending number."""
        self._unseen = {track: scans + 1 for track, scans in self._unseen.items()}
        labelled, heights = tracks.labelled(found), geodetic.heights(found).tolist()
        for track, row in labelled:
            trail = self._trails.setdefault(track, deque(maxlen=self._length))
            trail.append(Waypoint(found.stamp_ns, found.state[row], heights[row]))
            self._unseen[track] = 0
        for track in [track for track, scans in self._unseen.items() if scans > UNSEEN_SCANS]:
            del self._trails[track], self._unseen[track]
        return [self._trails[track] for track, _ in labelled]

    def clear(self) -> None:
        """Remove all trails; a new run uses the same numbers for other tracks."""
        self._trails, self._unseen = {}, {}


def _geojson_types() -> tuple[Any] | None:
    """Return the class of GeoJSON messages; None if it is not installed."""
    kind = geo_json.installed()
    return None if kind is None else (kind,)


class Outputs:
    """The tracker's publishers; silent while the node is not active.

    Parameters
    ----------
    node : LifecycleNode
    settings : Settings
    health : OutputHealth
        Counts subscriptions with an incompatible QoS.

    Raises
    ------
    ConfigError
        If an output's QoS override is not valid.
    """

    def __init__(self, node: LifecycleNode, settings: Settings, health: OutputHealth) -> None:
        self._node = node
        self._frame = settings.config.world_frame
        self._plane = settings.config.plane
        self._datum = 0.0 if self._plane is None else self._plane.origin[2]
        self._radars = settings.config.model.radars
        self._class_names = tuple(c.name for c in settings.config.model.modes.classes)
        self._trails = Trails(PATH_LENGTH)
        self._made: list[Any] = []
        wanted = settings.node["outputs"]
        self._with_markers = "markers" in wanted

        def make(kind: type, topic: str, qos: Callable[[], Any] = endpoints.output_qos) -> Any:
            self._made.append(endpoints.publisher(node, kind, topic, qos(), health))
            return self._made[-1]

        try:
            self._clouds = {s: make(PointCloud2, f"~/{s}/estimates") for s in SOURCES}
            self._poses = {
                source: [
                    make(PoseArray, f"~/{source}/class_{k}/poses")
                    for k in range(len(self._class_names))
                ]
                for source in SOURCES
            }
            self._detections = make(PointCloud2, "~/detections") if "detections" in wanted else None
            self._markers = make(MarkerArray, "~/markers", endpoints.latched_qos)
            mapped = any(radar.clutter_map is not None for radar in self._radars)
            self._clutter = (
                make(OccupancyGrid, "~/clutter_map", endpoints.latched_qos) if mapped else None
            )
            self._cardinality = make(DiagnosticArray, "~/cardinality")
            self._plots = {
                quantity: make(Float64, f"~/plot/{quantity}")
                for quantity in quantities.of_tracker(
                    len(self._class_names), settings.config.engine
                )
                if "plots" in wanted
            }
            self._path = make(Path, "~/tracks/path") if "paths" in wanted else None
            self._odometry = make(Odometry, "~/odometry") if "odometry" in wanted else None
            self._navsat = make(NavSatFix, "~/navsat") if "navsat" in wanted else None
            self._geojson = self._make_optional(
                make, _geojson_types, "~/tracks/geojson", "geojson", wanted
            )
            self._radar_tracks = self._make_optional(
                make, radar_tracks.installed, "~/radar_tracks", "radar_tracks", wanted
            )
            self._detections_3d = self._make_optional(
                make, vision.installed, "~/detections_3d", "detections_3d", wanted
            )
        except Exception:
            self.destroy()
            raise
        self._run = uuid.uuid4()
        self._clutter_ns: int | None = None

    @staticmethod
    def _make_optional(
        make: Callable[..., Any],
        installed: Callable[[], Any],
        topic: str,
        output: str,
        wanted: Collection[str],
    ) -> tuple[Any, Any] | None:
        """Return a publisher of messages of an optional package, and their classes."""
        if output not in wanted:
            return None
        types = installed()
        if types is None:
            raise ConfigError(
                [f"outputs: {output} given, but its message package is not installed"]
            )
        return make(types[0], topic), types

    def destroy(self) -> None:
        """Destroy all publishers."""
        while self._made:
            self._node.destroy_lifecycle_publisher(self._made.pop())

    def forget(self) -> None:
        """Begin a new run."""
        self._trails.clear()
        self._clutter_ns = None
        self._run = uuid.uuid4()

    def show_markers(self, shown: bool) -> None:
        """Publish markers from now on, or delete those that were published."""
        if not shown:
            self.clear_markers()
        self._with_markers = shown

    def clear_markers(self) -> None:
        """Delete the published markers; the topic is latched, so late joiners would get them."""
        if self._with_markers:
            clear = Marker(header=stamps.header(0, self._frame), action=Marker.DELETEALL)
            self._markers.publish(MarkerArray(markers=[clear]))

    def publish_detections(self, scan: Scan) -> None:
        """Publish a scan's detections, those of all radars together."""
        if self._detections is not None:
            self._detections.publish(detections_in_map.to_msg(scan, self._radars, self._frame))

    def publish_estimates(self, source: str, found: Estimates) -> None:
        """Publish the ``filtered`` or ``smoothed`` estimates of a stamp."""
        self._clouds[source].publish(estimates.to_msg(found, self._frame))
        for class_id, publisher in enumerate(self._poses[source]):
            publisher.publish(poses.to_cdr(found, class_id, self._frame))

    def publish_filtered(self, found: Estimates) -> None:
        """Publish a scan's filtered estimates on all topics that show them."""
        self.publish_estimates(FILTERED, found)
        if self._with_markers:
            self._markers.publish(
                markers.to_cdr(found, self._frame, self._class_names, self._datum)
            )
        if self._radar_tracks is not None:
            publisher, types = self._radar_tracks
            publisher.publish(radar_tracks.to_msg(found, self._frame, self._run, types))
        if self._detections_3d is not None:
            publisher, types = self._detections_3d
            publisher.publish(vision.to_msg(found, self._frame, self._class_names, types))
        self._publish_trails(found)
        if self._odometry is not None:
            for message in tracks.to_odometry(found, self._frame):
                self._odometry.publish(message)

    def _publish_trails(self, found: Estimates) -> None:
        """Publish what shows where tracks were, and where on the earth they are."""
        if self._path is not None or self._geojson is not None:
            trails = self._trails.add(found)
            if self._path is not None:
                for trail in trails:
                    self._path.publish(tracks.to_path(trail, self._frame))
            if self._geojson is not None:
                publisher, (kind,) = self._geojson
                ways = {
                    track: np.column_stack(
                        [
                            np.array([point.state for point in trail])[
                                :, list(found.space.position)
                            ],
                            tracks.known_heights(trail),
                        ]
                    )
                    for (track, _), trail in zip(tracks.labelled(found), trails, strict=True)
                }
                publisher.publish(
                    geo_json.to_msg(found, self._plane, self._class_names, ways, kind)
                )
        if self._navsat is not None:
            for message in navsat.to_msgs(found, self._plane):
                self._navsat.publish(message)

    def publish_clutter(self, stamp_ns: int, engine: Engine) -> None:
        """Publish where clutter comes from, if that is learned and was not published lately."""
        last = self._clutter_ns
        if self._clutter is None or (last is not None and stamp_ns - last < CLUTTER_PERIOD_S * 1e9):
            return
        shown = engine.clutter_raster()
        if shown is not None:
            self._clutter_ns = stamp_ns
            self._clutter.publish(clutter_maps.to_msg(shown, stamp_ns, self._frame))

    def publish_cardinality(self, stamp_ns: int, step: Step, step_ms: float) -> None:
        """Publish the figures of a step."""
        mass = {name: float(m) for name, m in zip(self._class_names, step.class_mass, strict=True)}
        values = {
            "total": float(np.sum(step.class_mass)),
            **mass,
            **step.figures,
            "unresolved": sum(estimates.unresolved for estimates in step.filtered),
            "step_ms": step_ms,
        }
        self._cardinality.publish(
            diagnostics.array(stamp_ns, [diagnostics.status("tracker/cardinality", values)])
        )
        if self._plots:
            for quantity, message in plots.step_to_msgs(step, step_ms).items():
                self._plots[quantity].publish(message)
