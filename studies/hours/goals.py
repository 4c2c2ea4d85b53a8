"""The goals of the study of hours: what tracks must be worth to a user who has set nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES

from ..runner import Goal, goal

# Ways to track a recording: nothing set; without codes and addresses; with what `tune` proposes.
AS_IS, NO_IDENTITIES, TUNED = WAYS = "nothing set", "no identities", "tuned"
# Least percentages of targets found, largest RMS errors and false tracks to the plot Kalman
# tracker's, and largest number of switches with addresses to it.
FOUND = {FILTERED: 99.0, SMOOTHED: 99.8}
RMS, FALSE, SWITCHES_WITH_ADDRESSES = {FILTERED: 0.8, SMOOTHED: 0.4}, 0.6, 0.1
# Hours whose targets have addresses.
WITH_ADDRESSES = ("approach_hour",)


def goals_of(hour: str, ways: Mapping[str, Mapping[str, Any]]) -> list[Goal]:
    """Return the goals of an hour; without tracks it is the exit status alone.

    Parameters
    ----------
    hour : str
    ways : mapping
        By name of the way, ``status``, the worst exit status of the commands, ``scores`` by source
        and ``plot_kalman``, as `Scores` in JSON.
    """
    goals = [
        goal(f"{hour}: exit status, {way}", ways[way]["status"], 0.0) for way in WAYS if way in ways
    ]
    if any(way not in ways or not ways[way]["scores"] for way in WAYS):
        return goals
    plain, bare, tuned = (ways[way]["scores"] for way in WAYS)
    peer = ways[AS_IS]["plot_kalman"]
    for way, scores in ((AS_IS, plain), (TUNED, tuned)):
        for source in SOURCES:
            found, rms = 100 * scores[source]["found"], scores[source]["rms"] / peer["rms"]
            goals += [
                goal(f"{hour}: found {source}, %, {way}", found, FOUND[source], False),
                goal(f"{hour}: RMS {source}, to plot Kalman, {way}", rms, RMS[source]),
            ]
    false = plain[FILTERED]["false_a_turn"]
    switches, without = plain[FILTERED]["switches"], bare[FILTERED]["switches"]
    goals += [
        # A bound rather than a ratio, because that tracker may have none.
        goal(f"{hour}: false tracks a turn", false, FALSE * peer["false_a_turn"]),
        goal(f"{hour}: identity switches without identities", without, float(peer["switches"])),
        goal(f"{hour}: identity switches with identities", switches, float(without)),
    ]
    if hour in WITH_ADDRESSES:
        most = SWITCHES_WITH_ADDRESSES * peer["switches"]
        goals.append(goal(f"{hour}: identity switches with addresses", switches, most))
    return goals
