"""The health of the hand-over: the estimates of each tracker, and the joint picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticStatus

from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.handover.picture import LATEST_STAMPS, JointPicture
from phd_jdtc_ros.quoting import counts_text

from ..common.health import Rhythm, Rises, first, status_of

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
# First guess of the interval between clouds: no surveillance radar turns more slowly, seconds.
LONGEST_REVOLUTION_S = 12.0


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
    _rhythm: Rhythm = field(default_factory=lambda: Rhythm(LONGEST_REVOLUTION_S))
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
    node: str,
    picture: JointPicture,
    published: Counter[str],
    tracks: int,
    alive: Sequence[str],
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
