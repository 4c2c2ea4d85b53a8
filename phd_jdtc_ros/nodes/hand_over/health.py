# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The health of the hand-over: of what each tracker says, and of the picture."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics, names

from ..common.seen import Seen


@dataclass
class Heard:
    """What was heard of a tracker.

    Parameters
    ----------
    clouds : Counter
        By source.
    refused : Counter
        Clouds that are not in the picture, by reason.
    last_s : float or None
        When the last cloud came, by the steady clock, seconds.
    """

    clouds: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    last_s: float | None = None

    def take(self, source: str) -> None:
        """Count a cloud."""
        self.clouds[source] += 1
        self.last_s = time.monotonic()


def of_tracker(
    name: str,
    node: str,
    heard: Heard,
    behind_s: float,
    limit_s: float,
    seen: Seen,
) -> DiagnosticStatus:
    """Return the status of a tracker's estimates.

    Parameters
    ----------
    name, node : str
        Of the status, and the full name of the tracker's node.
    heard : Heard
    behind_s : float
        How much older its estimates are than the newest of all, seconds.
    limit_s : float
        From when on it is silent, by its stamps or by the wall clock, seconds.
    seen : Seen
    """
    quiet_s = 0.0 if heard.last_s is None else time.monotonic() - heard.last_s
    values = {
        "clouds": sum(heard.clouds.values()),
        "behind_s": behind_s,
        "quiet_s": quiet_s,
        **{f"refused_{reason}": count for reason, count in sorted(heard.refused.items())},
    }
    level, text = DiagnosticStatus.WARN, ""
    if heard.last_s is None:
        text = "never heard"
    elif behind_s > limit_s:
        text = f"silent: its estimates are {behind_s:.1f} s behind; the picture is without it"
    elif seen.rose(f"{name} refused", sum(heard.refused.values())):
        listed = ", ".join(f"{reason} {count}" for reason, count in sorted(heard.refused.items()))
        text = f"left out: {listed}"
    elif quiet_s > limit_s:
        text = f"silent for {quiet_s:.1f} s"
    else:
        level, text = DiagnosticStatus.OK, f"{heard.clouds['filtered']} stamps"
    return diagnostics.status(name, values, level, text, node)


def of_picture(
    node: str, published: Counter[str], tracks: int, handed_over: int, alone: bool
) -> DiagnosticStatus:
    """Return the status of the joint picture; `alone` if less than two trackers are in it."""
    values = {**published, "tracks": tracks, "handed_over": handed_over}
    level = DiagnosticStatus.OK
    text = f"{tracks} tracks, {handed_over} changes from one tracker to another"
    if not published:
        level, text = DiagnosticStatus.WARN, "nothing published"
    elif alone:
        level, text = DiagnosticStatus.WARN, "of one tracker alone"
    return diagnostics.status(names.health("picture", node), values, level, text, node)
