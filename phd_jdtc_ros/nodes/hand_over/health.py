"""The health of the hand-over: of what each tracker says, and of the picture."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics, names
from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.handover.picture import LATEST_STAMPS

from ..common.health import Seen

# Of so many of the latest clouds the usual interval is taken. Until there is one: no surveillance
# radar turns more slowly, seconds.
INTERVALS, LONGEST_TURN_S = 5, 12.0


@dataclass
class Heard:
    """What was heard of a tracker.

    Parameters
    ----------
    limit_s : float
        For how much longer than its usual interval it may be quiet, seconds.
    clouds : Counter
        By source.
    refused : Counter
        Clouds that are not in the picture, by reason.
    left_out : bool
        Whether the latest cloud is not in the picture.
    last_s : float or None
        When the last cloud came, by the steady clock, seconds.
    """

    limit_s: float
    clouds: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    left_out: bool = False
    last_s: float | None = None
    _filtered_s: float | None = None
    _intervals: deque[float] = field(default_factory=lambda: deque(maxlen=INTERVALS))

    def take(self, source: str, now_s: float) -> None:
        """Count a cloud that came at a time of the steady clock."""
        self.clouds[source] += 1
        self.last_s = now_s
        self.left_out = False
        if source == FILTERED:
            if self._filtered_s is not None:
                self._intervals.append(now_s - self._filtered_s)
            self._filtered_s = now_s

    def refuse(self, reason: str) -> None:
        """Count the cloud that was taken last as one that is not in the picture."""
        self.refused[reason] += 1
        self.left_out = True

    @property
    def reasons(self) -> str:
        """Why clouds are not in the picture, and how many."""
        return ", ".join(f"{reason} {count}" for reason, count in sorted(self.refused.items()))

    def quiet_s(self, now_s: float) -> float:
        """Return for how long nothing has come, seconds; 0 before the first cloud."""
        return 0.0 if self.last_s is None else now_s - self.last_s

    def is_quiet(self, now_s: float) -> bool:
        """Return whether nothing has come for longer than usual."""
        usual = median(self._intervals) if self._intervals else LONGEST_TURN_S
        return self.quiet_s(now_s) > self.limit_s + usual


def of_tracker(
    name: str,
    node: str,
    heard: Heard,
    behind_s: float,
    silent: bool,
    now_s: float,
    seen: Seen,
    hint: str = "",
) -> DiagnosticStatus:
    """Return the status of a tracker's estimates.

    Parameters
    ----------
    name, node : str
        Of the status, and the full name of the tracker's node.
    behind_s : float
        How much older its estimates are than the newest of all, seconds.
    silent : bool
        Whether the picture is without it.
    now_s : float
        By the steady clock, seconds.
    hint : str
        What there is instead of its estimates, in words; empty if they are published.
    """
    quiet_s = heard.quiet_s(now_s)
    values = {
        "clouds": sum(heard.clouds.values()),
        "behind_s": behind_s,
        "quiet_s": quiet_s,
        **{f"refused_{reason}": count for reason, count in sorted(heard.refused.items())},
    }
    without = "; the picture is without it" if silent else ""
    level, text = DiagnosticStatus.WARN, ""
    refused = seen.rose(f"{name} refused", sum(heard.refused.values()))
    if heard.last_s is None:
        text = "; ".join(filter(None, ("never heard", hint)))
    elif heard.is_quiet(now_s):
        text = f"silent for {quiet_s:.1f} s{without}"
    elif refused or (silent and heard.left_out):
        text = f"left out: {heard.reasons}{without}"
    elif silent:
        text = f"silent: its estimates are {behind_s:.1f} s behind{without}"
    else:
        level, text = DiagnosticStatus.OK, f"{heard.clouds[FILTERED]} stamps"
    return diagnostics.status(name, values, level, text, node)


def of_picture(
    node: str,
    published: Counter[str],
    tracks: int,
    handed_over: int,
    parted: int,
    alive: Sequence[str],
    overflow: int = 0,
) -> DiagnosticStatus:
    """Return the status of the joint picture.

    Parameters
    ----------
    node : str
        Full name of the node.
    published : Counter
        Clouds by source.
    parted : int
        How many of the latest `LATEST_STAMPS` were of some trackers only, silent ones apart.
    alive : sequence of str
        Names of the trackers that are heard and in the picture.
    overflow : int
        How many stamps went out before they were complete, because too many waited.
    """
    values = {
        **published,
        "tracks": tracks,
        "handed_over": handed_over,
        "parted_stamps": parted,
        "stamps_overflow": overflow,
    }
    level = DiagnosticStatus.WARN
    if not published:
        text = "nothing published"
    elif not alive:
        text = "no tracker is heard any more"
    elif len(alive) == 1:
        text = f"of one tracker alone: {alive[0]}"
    elif parted > LATEST_STAMPS // 2:
        text = (
            f"stamps are not common: {parted} of the last {LATEST_STAMPS} are of some trackers "
            "only; set estimates_period_s of all trackers to the same"
        )
    else:
        level = DiagnosticStatus.OK
        text = f"{tracks} tracks, {handed_over} changes from one tracker to another"
    return diagnostics.status(names.health("picture", node), values, level, text, node)
