"""The goals of the study of hours: what tracks must be worth to a user who has set nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES

from .hours import Scores

# Ways to track a recording: nothing set; without codes and addresses; with what `tune` proposes.
AS_IS, NO_IDENTITIES, TUNED = WAYS = "nothing set", "no identities", "tuned"
# Least percentages of targets found, largest RMS errors and false tracks to the plot Kalman
# tracker's, and largest number of switches with addresses to it.
FOUND = {FILTERED: 99.0, SMOOTHED: 99.8}
RMS, FALSE, SWITCHES_WITH_ADDRESSES = {FILTERED: 0.8, SMOOTHED: 0.4}, 0.6, 0.1
# Hours whose targets have addresses.
WITH_ADDRESSES = ("approach_hour",)


class Tracked(NamedTuple):
    """What one way to track an hour gave.

    Parameters
    ----------
    status : int
        The worst exit status of the commands.
    cpu_s : float
        CPU time of `track_bag`.
    scores : mapping of source to Scores, or None
        None if there are no tracks.
    peer : Scores or None
        Of the plot Kalman tracker, at the same times.
    """

    status: int
    cpu_s: float
    scores: Mapping[str, Scores] | None
    peer: Scores | None

    def figures(self) -> dict[str, Any]:
        """Return all as JSON has it."""
        return {
            "status": self.status,
            "cpu_s": self.cpu_s,
            "scores": {name: each._asdict() for name, each in (self.scores or {}).items()},
            "plot_kalman": self.peer._asdict() if self.peer else None,
        }


def goals_of(hour: str, ways: Mapping[str, Tracked]) -> list[dict[str, Any]]:
    """Return the goals of an hour as in a study's summary.

    Without tracks it is the exit status alone.
    """
    goals = [
        _goal(f"{hour}: exit status, {way}", ways[way].status, 0.0) for way in WAYS if way in ways
    ]
    whole = [ways[way] for way in WAYS if way in ways and ways[way].scores]
    if len(whole) < len(WAYS):
        return goals
    plain, bare, tuned = whole
    peer = plain.peer
    if plain.scores is None or bare.scores is None or tuned.scores is None or peer is None:
        return goals
    for way, each in ((AS_IS, plain.scores), (TUNED, tuned.scores)):
        for source in SOURCES:
            own = each[source]
            goals += [
                _goal(f"{hour}: found {source}, %, {way}", 100 * own.found, FOUND[source], False),
                _goal(
                    f"{hour}: RMS {source}, to plot Kalman, {way}", own.rms / peer.rms, RMS[source]
                ),
            ]
    false = plain.scores[FILTERED].false_a_turn
    switches, without = plain.scores[FILTERED].switches, bare.scores[FILTERED].switches
    goals += [
        # A bound rather than a ratio, because that tracker may have none.
        _goal(f"{hour}: false tracks a turn", false, FALSE * peer.false_a_turn),
        _goal(f"{hour}: identity switches without identities", without, peer.switches),
        _goal(f"{hour}: identity switches with identities", switches, without),
    ]
    if hour in WITH_ADDRESSES:
        most = SWITCHES_WITH_ADDRESSES * peer.switches
        goals.append(_goal(f"{hour}: identity switches with addresses", switches, most))
    return goals


def _goal(name: str, value: float, bound: float, at_most: bool = True) -> dict[str, Any]:
    reached = value <= bound if at_most else value >= bound
    return {
        "name": name,
        "value": float(value),
        "goal": float(bound),
        "at_most": at_most,
        "reached": bool(reached),
    }
