"""Executables with one thing changed, for `forked`: each takes the arguments of its node."""

from phd_jdtc_ros.core.window.fixed_lag import GaussianEngine
from phd_jdtc_ros.nodes import playback, replay
from phd_jdtc_ros.nodes.tracker import node as tracker


def failing_tracker(arguments):
    """Run a tracker whose third step fails when all of it is done."""
    step, scans = GaussianEngine.step, []

    def fail(engine, scan, *rest):
        scans.append(scan)
        found = step(engine, scan, *rest)
        if len(scans) == 3:
            raise ArithmeticError("half-way")
        return found

    GaussianEngine.step = fail
    return tracker.main(arguments)


def hasty_replay(arguments):
    """Run a replay that gives up as soon as a test can wait for."""
    playback.GIVE_UP_S = 3.0
    replay.MAX_TRUTH_S, replay.ACKNOWLEDGE_S = 2.0, 1.0
    return replay.main(arguments)
