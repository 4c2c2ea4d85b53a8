"""The goals of the study of hours: quality of the tracks without a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES

from ..runner import Goal, goal

# Ways to track a recording: without a configuration, without codes and addresses, and with the
# parameters that `tune` proposes.
AS_IS, NO_IDENTITIES, TUNED = WAYS = "nothing set", "no identities", "tuned"
# Goals: least percentage of targets found, and largest ratios of RMS error, of false tracks and,
# with addresses, of identity switches to the plot Kalman tracker's.
FOUND = {FILTERED: 99.0, SMOOTHED: 99.8}
RMS, FALSE, SWITCHES_WITH_ADDRESSES = {FILTERED: 0.8, SMOOTHED: 0.4}, 0.6, 0.1
# Hours whose targets have addresses.
WITH_ADDRESSES = ("approach_hour",)


def goals_of(hour: str, ways: Mapping[str, Mapping[str, Any]]) -> list[Goal]:
    """Return the goals of an hour; the exit status alone if there are no tracks.

    Each way has its ``status``, the worst exit status of the commands, ``scores`` by source and
    ``plot_kalman``, as `Scores` in JSON.
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
    false = plain[FILTERED]["false_a_revolution"]
    switches, without = plain[FILTERED]["switches"], bare[FILTERED]["switches"]
    goals += [
        # An absolute bound, because the reference may have no false tracks.
        goal(f"{hour}: false tracks a turn", false, FALSE * peer["false_a_revolution"]),
        goal(f"{hour}: identity switches without identities", without, float(peer["switches"])),
        goal(f"{hour}: identity switches with identities", switches, float(without)),
    ]
    if hour in WITH_ADDRESSES:
        most = SWITCHES_WITH_ADDRESSES * peer["switches"]
        goals.append(goal(f"{hour}: identity switches with addresses", switches, most))
    return goals
