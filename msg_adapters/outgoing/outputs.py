"""The tables of the tracker's outputs: topics with type, trigger and encoder, and streams.

Publishers, recordings, the list on the tracker's page and the SROS2 policies derive from the first.
A stream has the format of other programs and is sent by UDP or TCP. A new output is a module with
its encoder, and a row here.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

from visualization_msgs.msg import Marker, MarkerArray

from phd_jdtc_ros.core.engine import Engine, Step
from phd_jdtc_ros.core.models.zones import Zone
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.core.types import FILTERED, SOURCES, Estimates, Pose

from ..encoding import interfaces, names, stamps
from ..targets import estimates, geo_json, geodetic, markers, objects, tracks
from ..targets.tracks import Trails
from . import conflicts, cot, diagnostics, manual, map_layers, nmea, sapient, signal_k

# Triggers besides the estimates of a source: a `Scan`, a `StepResult`, `Conflicts`, and manual work
# with its stamp.
SCAN, STEP, CONFLICTS, MANUAL = "scan", "step", "conflicts", "manual"


@dataclass
class StepResult:
    """A step whose estimates have been published."""

    stamp_ns: int  # Stamp of its scan
    step: Step
    step_ms: float  # CPU time of the step, milliseconds
    engine: Engine

    @cached_property
    def numbers(self) -> dict[str, float]:
        """The numbers to plot, by name."""
        return diagnostics.of_step(self.step, self.step_ms)


@dataclass
class View:
    """Context of a tracker's messages."""

    frame: str  # The world frame
    class_names: tuple[str, ...]
    radars: Sequence[Sensor]  # In the configured order
    plane: Plane | None  # Placement of the world frame on the earth
    trails: Trails
    has_clutter_map: bool = False
    zones: Sequence[Zone] | None = None  # Of the conflicts; None if none are watched
    run: uuid.UUID = field(default_factory=uuid.uuid4)  # Identifies the tracker's run
    # Returns own ship's pose at a stamp, see `Pipeline.own_pose`.
    own_pose: Callable[[int], Pose | None] = lambda stamp_ns: None
    manual: Callable[[], Manual] = Manual  # Returns the operator's entries
    types: Sequence[str] = ()  # Types of the classes in Cursor on Target; empty for that of all
    stale_s: float = 0.0  # Time after which a track that is not reported again is stale
    numbers: nmea.TargetNumbers = field(default_factory=nmea.TargetNumbers)

    def begin_run(self) -> None:
        """Begin a new run, in which track numbers start again."""
        self.trails.clear()
        self.run = uuid.uuid4()

    @property
    def datum(self) -> float:
        """Height of the map's zero, metres."""
        return 0.0 if self.plane is None else self.plane.origin[2]


# Equal only to itself, which makes it a cheap key of a dictionary.
@dataclass(frozen=True, eq=False)
class Output:
    """An output topic of the tracker."""

    topic: str  # Topic below ``~/``, which stands for the tracker's name
    type_name: str
    # `FILTERED` or `SMOOTHED`, for each set of estimates, or `SCAN`, `STEP` or `CONFLICTS`.
    when: str
    # Returns the messages, or their bytes, given the trigger's value.
    encode: Callable[[Any, View], Iterable[Any]]
    switch: str = ""  # Name by which a user enables the output; empty if it is always on
    usual: bool = True  # True if the output is on by default
    latched: bool = False  # True if late subscribers receive the last message
    # Returns whether the output applies to this tracker.
    needs: Callable[[View], bool] = lambda _: True
    period_s: float = 0.0  # Shortest time between two messages, by the stamps of scans
    # True if its encoder keeps what it is given, and needs it even without subscribers.
    remembers: bool = False
    on_earth: bool = False  # True if the output needs the world frame's place on the earth
    # Returns the message that clears the display, for an output that may be switched off at run
    # time.
    clear: Callable[[View], Any] | None = None


@dataclass(frozen=True)
class Stream:
    """An output in the format of other programs, sent by UDP or TCP."""

    switch: str  # Name by which a user enables the output
    form: str  # Its format, with which the names of its destinations begin
    # Returns one message for each datagram, given own ship's pose if it is known.
    encode: Callable[[Estimates, View, Pose | None], list[bytes]]
    on_earth: bool = True  # True if the output needs the world frame's place on the earth
    # Returns what a connection begins with, given the first estimates.
    greet: Callable[[Estimates, View], list[bytes]] = lambda found, view: []
    datagrams: bool = True  # Whether it may be sent by UDP
    imports: str = ""  # The package that writes the format; empty if none is needed


def table(classes: int, engine: str | None = None) -> tuple[Output, ...]:
    """Return all outputs of a tracker; without `engine` the engine's own figures are left out."""
    return (
        *(
            Output(
                names.estimates(source, "~"),
                names.CLOUD,
                when=source,
                encode=lambda found, view: [estimates.to_cdr(found, view.frame)],
            )
            for source in SOURCES
        ),
        *(
            Output(names.poses(source, k, "~"), names.POSES, source, _poses_of(k))
            for source in SOURCES
            for k in range(classes)
        ),
        Output(
            names.detections_in_map("~"),
            names.CLOUD,
            when=SCAN,
            encode=lambda scan, view: [map_layers.detections_to_cdr(scan, view.radars, view.frame)],
            switch="detections",
        ),
        Output(
            "~/markers",
            names.MARKERS,
            when=FILTERED,
            encode=lambda found, view: [
                markers.to_cdr(found, view.frame, view.class_names, view.datum)
            ],
            switch="markers",
            latched=True,
            clear=_no_markers,
        ),
        Output(
            names.clutter_map("~"),
            names.GRID,
            when=STEP,
            encode=_clutter_map,
            usual=False,
            latched=True,
            needs=lambda view: view.has_clutter_map,
            # Shortest time between two clutter maps, seconds, by the stamps of scans.
            period_s=10.0,
        ),
        Output(
            names.manual("~"),
            names.FIGURES,
            when=MANUAL,
            encode=lambda done, view: [manual.to_msg(*done)],
        ),
        Output(
            names.conflicts("~"),
            names.CLOUD,
            when=CONFLICTS,
            encode=lambda found, view: [conflicts.to_cdr(found, view.frame)],
            usual=False,
            needs=lambda view: view.zones is not None,
        ),
        Output(
            f"{names.conflicts('~')}/markers",
            names.MARKERS,
            when=CONFLICTS,
            encode=lambda found, view: [conflicts.to_markers(found, view.zones or (), view.frame)],
            usual=False,
            latched=True,
            needs=lambda view: view.zones is not None,
        ),
        Output(
            names.cardinality("~"),
            names.FIGURES,
            when=STEP,
            encode=lambda done, view: [
                diagnostics.step_to_cdr(done.stamp_ns, done.step, done.step_ms, view.class_names)
            ],
        ),
        *(
            Output(names.curve(quantity, "~"), names.NUMBER, STEP, _number_of(quantity), "curves")
            for quantity in diagnostics.of_tracker(classes, engine)
        ),
        *(
            Output(
                topic,
                kind,
                FILTERED,
                encode,
                switch,
                usual=False,
                remembers=encode in (_paths, _geojson),
                on_earth=encode in (_fixes, _geojson),
            )
            for topic, kind, encode, switch in (
                ("~/tracks/path", names.PATH, _paths, "paths"),
                ("~/odometry", names.ODOMETRY, _odometry, "odometry"),
                (names.fixes("~"), names.FIX, _fixes, "navsat"),
                ("~/tracks/geojson", names.GEOJSON, _geojson, "geojson"),
                ("~/radar_tracks", names.RADAR_TRACKS, _tracks, "radar_tracks"),
                ("~/detections_3d", names.DETECTIONS_3D, _vision, "detections_3d"),
                ("~/tracked_objects", names.TRACKED_OBJECTS, _tracked_objects, "tracked_objects"),
                ("~/obstacles", names.OBSTACLES, _obstacles, "obstacles"),
                ("~/derived_objects", names.DERIVED_OBJECTS, _derived_objects, "derived_objects"),
            )
        ),
    )


def default_topics(
    classes: int,
    tracker: str = names.TRACKER,
    scores: str = names.OSPA,
    evaluator: str = names.EVALUATOR,
    engine: str | None = "gaussian",
) -> dict[str, str]:
    """Return the topics that tracker and evaluator publish by default, with their types.

    Without `engine` the engine's own figures are left out, see `optional`.
    """
    numbers = (names.curve(quantity, evaluator) for quantity in diagnostics.of_evaluator(classes))
    return {
        **_types((row for row in table(classes, engine) if row.usual), tracker),
        **dict.fromkeys(numbers, names.NUMBER),
        names.DIAGNOSTICS: names.FIGURES,
        scores: names.FIGURES,
    }


def optional(tracker: str = names.TRACKER) -> dict[str, str]:
    """Return the topics that are not common to all trackers, with their types.

    These are the figures of a single engine, and the outputs that are off by default.
    """
    figures = (name for figures in diagnostics.FIGURES.values() for name in figures)
    return {
        **{names.curve(name, tracker): names.NUMBER for name in figures},
        **_types((row for row in table(0) if not row.usual), tracker),
    }


def _types(rows: Iterable[Output], tracker: str) -> dict[str, str]:
    return {row.topic.replace("~", tracker, 1): row.type_name for row in rows}


def _poses_of(class_id: int) -> Callable[[Estimates, View], list[bytes]]:
    return lambda found, view: [tracks.poses_to_cdr(found, class_id, view.frame)]


def _no_markers(view: View) -> MarkerArray:
    clear = Marker(header=stamps.header(0, view.frame), action=Marker.DELETEALL)
    return MarkerArray(markers=[clear])


def _clutter_map(done: StepResult, view: View) -> list[Any]:
    raster = done.engine.clutter_raster()
    return [] if raster is None else [map_layers.clutter_to_msg(raster, done.stamp_ns, view.frame)]


def _number_of(quantity: str) -> Callable[[StepResult, View], list[Any]]:
    return lambda done, _: [diagnostics.to_msg(done.numbers[quantity])]


def _paths(found: Estimates, view: View) -> list[Any]:
    return [tracks.to_path(trail, view.frame) for trail in view.trails.of(found).values()]


def _odometry(found: Estimates, view: View) -> list[Any]:
    return tracks.to_odometry(found, view.frame)


def _fixes(found: Estimates, view: View) -> list[Any]:
    return [] if view.plane is None else geodetic.to_msgs(found, view.plane)


def _geojson(found: Estimates, view: View) -> list[Any]:
    if view.plane is None:
        return []
    ways = {track: tracks.way(trail) for track, trail in view.trails.of(found).items()}
    document = geo_json.of_scan(found, view.plane, view.class_names, ways)
    return [interfaces.message_class(names.GEOJSON)(geojson=geo_json.text(document))]


def _tracks(found: Estimates, view: View) -> list[Any]:
    return [tracks.to_radar_tracks(found, view.frame, view.run)]


def _tracked_objects(found: Estimates, view: View) -> list[Any]:
    return [objects.to_tracked_objects(found, view.frame, view.class_names, view.run)]


def _obstacles(found: Estimates, view: View) -> list[Any]:
    return [objects.to_obstacles(found, view.frame, view.run)]


def _derived_objects(found: Estimates, view: View) -> list[Any]:
    return [objects.to_derived_objects(found, view.frame, view.class_names)]


def _vision(found: Estimates, view: View) -> list[Any]:
    return [tracks.to_detections_3d(found, view.frame, view.class_names)]


def _ttm(found: Estimates, view: View, own: Pose | None, relative: bool = False) -> list[bytes]:
    if own is None:
        return []
    targets = view.numbers.of(found, own.position, view.manual().names)
    return nmea.ttm(targets, own, view.plane, relative)


def _tll(found: Estimates, view: View, own: Pose | None) -> list[bytes]:
    centre = (0.0, 0.0) if own is None else own.position
    targets = view.numbers.of(found, centre, view.manual().names)
    return [] if view.plane is None else nmea.tll(targets, view.plane)


def _cot(found: Estimates, view: View, own: Pose | None) -> list[bytes]:
    if view.plane is None:
        return []
    sent = found, view.plane, view.class_names, view.types, view.run, view.stale_s
    return cot.events(*sent, view.manual())


def _signal_k(found: Estimates, view: View, own: Pose | None) -> list[bytes]:
    if view.plane is None:
        return []
    return signal_k.deltas(found, view.plane, view.types, view.run, view.manual().names)


def _sapient(found: Estimates, view: View, own: Pose | None) -> list[bytes]:
    if view.plane is None:
        return []
    return sapient.reports(found, view.plane, view.class_names, view.run, view.manual())


def _register(found: Estimates, view: View) -> list[bytes]:
    return [sapient.registration(found.stamp_ns, view.run, view.class_names, view.stale_s / 3.0)]


# Output of relative bearings, which needs own ship's heading.
RELATIVE = "ttm_relative"
STREAMS = (
    Stream("ttm", "nmea", _ttm, on_earth=False),
    Stream(RELATIVE, "nmea", partial(_ttm, relative=True), on_earth=False),
    Stream("tll", "nmea", _tll),
    Stream("cot", "cot", _cot),
    Stream("signalk", "signalk", _signal_k),
    Stream("sapient", "sapient", _sapient, greet=_register, datagrams=False, imports="sapient_msg"),
)

# The words of the outputs that a user enables, and those of them that need a place on the earth.
SWITCHES = (
    *dict.fromkeys(row.switch for row in table(0) if row.switch),
    *(row.switch for row in STREAMS),
)
ON_THE_EARTH = (
    *(row.switch for row in table(0) if row.on_earth),
    *(row.switch for row in STREAMS if row.on_earth),
)
