"""Joins the estimates of trackers of neighbouring areas, live, with common track numbers."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import RejectedMessageError, quote
from msg_adapters.targets import estimates
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.core.intake.clocks import CLOCK, Clocks
from phd_jdtc_ros.core.types import FILTERED, SOURCES, Estimates
from phd_jdtc_ros.handover import picture, settings
from phd_jdtc_ros.handover.picture import LATEST_STAMPS, Joint, JointPicture, Refusal
from phd_jdtc_ros.parameter_files.sections import ParameterFile
from phd_jdtc_ros.quoting import counts_text

from .common import parameters, runtime, topics
from .common.health import HealthReports, Rhythm, Rises, ThrottledWarnings, first, status_of
from .common.runtime import RunnableNode, serve

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


@dataclass
class TrackerHealth:
    """The estimates received from a tracker."""

    # The tracker is quiet after its usual interval plus this time without clouds, seconds.
    limit_s: float
    clouds: Counter[str] = field(default_factory=Counter)  # By source
    # Clouds that are not in the picture, by reason.
    refused: Counter[str] = field(default_factory=Counter)
    # How far its stamps are ahead of those of other trackers, seconds; None if they agree.
    clock_offset_s: float | None = None
    left_out: bool = False  # True if the latest cloud is not in the picture
    last_s: float | None = None  # Time of the last cloud by the steady clock
    # First guess of the interval between clouds: no surveillance radar turns more slowly, seconds.
    _rhythm: Rhythm = field(default_factory=lambda: Rhythm(12.0))
    _rises: Rises = field(default_factory=Rises)

    def take(self, source: str, now_s: float) -> None:
        """Count a cloud that arrives now."""
        self.clouds[source] += 1
        self.last_s = now_s
        self.left_out = False
        if source == FILTERED:
            self._rhythm.beat(now_s)

    def refuse(self, reason: str) -> None:
        """Count the last cloud as one that is not in the picture."""
        self.refused[reason] += 1
        self.left_out = True

    def quiet_s(self, now_s: float) -> float:
        """Return the time since the last cloud, seconds; 0 before the first one."""
        return 0.0 if self.last_s is None else now_s - self.last_s

    def is_quiet(self, now_s: float) -> bool:
        """Return whether nothing has arrived for longer than usual."""
        return self.quiet_s(now_s) > self.limit_s + self._rhythm.interval_s

    def status(
        self,
        node: str,
        line: str,
        tracker: str,
        behind_s: float,
        silent: bool,
        now_s: float,
        hint: str = "",
    ) -> DiagnosticStatus:
        """Return the status of the tracker's estimates, as a line of the node.

        `tracker` is the tracker's full name. Its estimates are `behind_s` older than the newest of
        all, and the picture is without it if it is `silent`. `hint` is the fault of a topic without
        estimates, empty if they are published.
        """
        quiet_s = self.quiet_s(now_s)
        values = {
            "clouds": self.clouds.total(),
            "behind_s": behind_s,
            "quiet_s": quiet_s,
            **{f"refused_{reason}": count for reason, count in sorted(self.refused.items())},
        }
        if self.clock_offset_s is not None:
            values["clock_offset_s"] = self.clock_offset_s
        clock_off = anomalies.clock_off(self.clock_offset_s, "trackers", "estimates")
        without = "; the picture is without it" if silent else ""
        refused = self._rises.recent("refused", self.refused.total(), now_s)
        left_out = refused or (silent and self.left_out)
        condition = first(
            (WARN, self.last_s is None, "; ".join(filter(None, ("no estimates yet", hint)))),
            (WARN, self.is_quiet(now_s), f"silent for {quiet_s:.1f} s{without}"),
            (ERROR, self.clock_offset_s is not None, clock_off),
            (WARN, left_out, f"left out: {counts_text(self.refused)}{without}"),
            (WARN, silent, f"silent: its estimates are {behind_s:.1f} s behind{without}"),
            (OK, True, f"{self.clouds[FILTERED]} stamps"),
        )
        return status_of(node, line, condition, values, tracker)


def of_picture(
    node: str, picture: JointPicture, published: Counter[str], tracks: int, alive: Sequence[str]
) -> DiagnosticStatus:
    """Return the joint picture's status; `alive` are the trackers that are in it and not quiet."""
    uncommon_stamps = picture.uncommon_stamps
    values = {
        **published,
        "tracks": tracks,
        "handed_over": picture.handed_over,
        "parted_stamps": uncommon_stamps,
        "stamps_overflow": picture.overflow,
    }
    uncommon = (
        f"stamps are not common: {uncommon_stamps} of the last {LATEST_STAMPS} are of some "
        "trackers only; set estimates_period_s of all trackers to the same"
    )
    condition = first(
        (WARN, not published, "nothing published"),
        (WARN, not alive, "all trackers are silent"),
        (WARN, len(alive) == 1, f"of one tracker alone: {', '.join(alive)}"),
        (WARN, uncommon_stamps > LATEST_STAMPS // 2, uncommon),
        (OK, True, f"{tracks} tracks, {picture.handed_over} changes from one tracker to another"),
    )
    return status_of(node, "picture", condition, values)


INPUT_DEPTH, OUTPUT_DEPTH = 50, 10
# Longest delay of a tracker whose clock is right: in delays that stamps wait, and at least so many
# seconds; and the longest gap in the estimates of a single one.
LONGEST_DELAY, LEAST_DELAY_S, LONGEST_GAP_S = 4.0, 30.0, 3600.0


class SentEstimates(NamedTuple):
    """The filtered estimates of a tracker."""

    sensor: int
    stamp_ns: int
    found: Estimates


class HandOver(RunnableNode):
    """Subscribes to the estimates of two trackers or more, and publishes one picture of them."""

    def __init__(self, files: Sequence[ParameterFile] = ()) -> None:
        super().__init__("hand_over")
        self._settings = settings.resolve(parameters.given_values(self, files))
        values = self._settings.values
        parameters.declare(self, self._settings.table, values)
        self._warnings = ThrottledWarnings(self.get_logger())
        limit_s = float(values["max_delay_s"])
        self._picture = JointPicture(
            self._settings.regions,
            self._settings.hysteresis,
            settings.SMOOTHED_WAIT_S,
            limit_s,
            # Stamps that may wait for another tracker: ten minutes, the longest delay, at two a
            # second.
            1200,
        )
        self._trackers = [TrackerHealth(limit_s) for _ in self._settings.names]
        reach_s = max(LONGEST_DELAY * limit_s, LEAST_DELAY_S)
        self._clocks: Clocks[SentEstimates] = Clocks(len(self._trackers), reach_s, LONGEST_GAP_S)
        self._silent: frozenset[int] = frozenset()
        self._classes: int | None = None
        self._frame: str | None = None
        self._published: Counter[str] = Counter()
        self._tracks = self._overflow = 0
        self._outputs = {
            source: self.create_publisher(
                PointCloud2, f"~/{source}/estimates", topics.reliable(OUTPUT_DEPTH)
            )
            for source in SOURCES
        }
        serve(self, "flush", self._flush)
        for tracker in range(len(self._settings.names)):
            for source in SOURCES:
                topics.subscribe(
                    self,
                    PointCloud2,
                    self._settings.topic(tracker, source),
                    partial(self._take, tracker, source),
                    INPUT_DEPTH,
                    "trackers",
                    self._settings.names[tracker],
                )
        HealthReports(self, self._statuses)
        self.get_logger().info(f"joining the estimates of {', '.join(self._settings.nodes)}")

    def close(self) -> None:
        """Log a summary; pending stamps are dropped."""
        self.get_logger().info(
            f"stopped; {self._published[FILTERED]} stamps joined, "
            f"{self._picture.handed_over} changes from one tracker to another"
        )

    def _take(self, tracker: int, source: str, cloud: PointCloud2) -> None:
        """Process a tracker's cloud, and publish the stamps that it completes."""
        own = self._trackers[tracker]
        own.take(source, time.monotonic())
        try:
            found = self._read(cloud)
        except RejectedMessageError as error:
            own.refuse(error.reason)
            topic = self._settings.topic(tracker, source)
            self._warnings.warn(topic, f"{topic}: {error}")
            return
        if source == FILTERED:
            sent = SentEstimates(tracker, found.stamp_ns, found)
            for each in self._clocks.add(sent, self.get_clock().now().nanoseconds):
                self._join(each.sensor, source, each.found)
            for each in self._clocks.take_left_out():
                self._trackers[each.sensor].refuse(CLOCK)
        elif self._clocks.offset_s(tracker) is not None:
            own.refuse(CLOCK)
        else:
            self._join(tracker, source, found)
        self._log_silent()

    def _join(self, tracker: int, source: str, found: Estimates) -> None:
        """Add a tracker's estimates to the picture, and publish the stamps that they complete."""
        if self._picture.jumps_back(tracker, source, found.stamp_ns):
            name = self._settings.names[tracker]
            self.get_logger().warning(f"{name}: its stamps went back; a new run begins")
        done = self._picture.add(tracker, source, found)
        if isinstance(done, Refusal):
            self._trackers[tracker].refuse(done.value)
        else:
            self._publish(done)
        if self._picture.overflow > self._overflow:
            self._overflow = self._picture.overflow
            text = "stamps went out without all trackers, because too many waited for them"
            self._warnings.warn("overflow", f"{self._overflow} {text}")

    def _read(self, cloud: PointCloud2) -> Estimates:
        """Return a cloud's estimates, or raise `RejectedMessageError`; the first sets the frame."""
        found = estimates.from_msg(cloud)
        frame, allowed = cloud.header.frame_id, self._frame or cloud.header.frame_id
        if frame != allowed:
            raise RejectedMessageError(
                "frame", f"frame is {quote(frame)}, must be {allowed!r} as in the first estimates"
            )
        classes = found.class_probability.shape[1]
        if self._classes is None:
            self._classes = classes
        if classes != self._classes:
            raise RejectedMessageError(
                "classes", f"{classes} classes, must be {self._classes} as in the first estimates"
            )
        reason = picture.fault_of(found)
        if reason is not None:
            raise RejectedMessageError(*reason)
        self._frame = allowed
        return found

    def _publish(self, done: Sequence[Joint]) -> None:
        for source, joint in done:
            self._published[source] += 1
            if source == FILTERED:
                self._tracks = len(joint)
            self._outputs[source].publish(estimates.to_cdr(joint, self._frame or ""))

    def _log_silent(self) -> None:
        """Log each tracker that the picture no longer waits for, or waits for again."""
        before, self._silent = self._silent, self._picture.silent
        for tracker in sorted(self._silent - before):
            own, behind_s = self._trackers[tracker], self._picture.behind_s(tracker)
            why = f"silent, its estimates are {behind_s:.1f} s behind"
            if own.left_out:
                why = f"its estimates are left out ({counts_text(own.refused)})"
            elif own.last_s is None:
                why = "no estimates yet"
            self.get_logger().warning(
                f"{self._settings.names[tracker]}: {why}; the picture goes on without it"
            )
        for tracker in sorted(before - self._silent):
            self.get_logger().info(f"{self._settings.names[tracker]}: in the picture again")

    def _flush(self) -> tuple[bool, str]:
        """Publish the pending stamps, and begin a new run."""
        done = self._picture.close_all()
        self._publish(done)
        return True, f"{len(done)} stamps published"

    def _hint(self, tracker: int) -> str:
        """Return the fault of a topic on which no estimates have arrived."""
        if self._trackers[tracker].clouds:
            return ""
        topic = self.resolve_topic_name(self._settings.topic(tracker, FILTERED))
        return topics.publisher_hint(self, topic, PointCloud2)

    def _statuses(self) -> list[DiagnosticStatus]:
        node, now_s = self.get_fully_qualified_name(), time.monotonic()
        picture, found, alive = self._picture, list[DiagnosticStatus](), list[str]()
        for tracker, (name, own) in enumerate(
            zip(self._settings.names, self._trackers, strict=True)
        ):
            silent, behind_s = tracker in picture.silent, picture.behind_s(tracker)
            full, hint = self._settings.nodes[tracker], self._hint(tracker)
            own.clock_offset_s = self._clocks.offset_s(tracker)
            found.append(own.status(node, name, full, behind_s, silent, now_s, hint))
            if not (silent or own.is_quiet(now_s)):
                alive.append(name)
        return [*found, of_picture(node, picture, self._published, self._tracks, alive)]


def main(argv: Sequence[str]) -> int:
    """Run the node."""
    files = parameters.given_files("hand_over", __doc__, argv)
    return runtime.run("hand_over", lambda: HandOver(files), argv)
