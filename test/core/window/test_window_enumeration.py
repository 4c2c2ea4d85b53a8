"""All estimates of a window, against what follows from each target's own scans, one by one."""

from dataclasses import dataclass

import numpy as np
import pytest
from marks import MODEL, PLACES, MarkEngine, MarkFilter, rule
from runs import stored_and_read

from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.tracks.common_stamp import Schedule
from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections, Scan

SLICES = 8
SLICE_NS = 500_000_000
TURN_NS = SLICES * SLICE_NS
# Beyond it a target is swept wherever it is; see `swept.LONGEST_TURNS`.
FORGOTTEN_NS = 1.5 * TURN_NS
NOTED = 0.25
LEAST = 0.5
SCANS = 28


def slice_of(index):
    """Return the scan of one slice of a turn; every other one has a target in its middle."""
    coverage = Coverage((index % SLICES - 0.5) * FULL_TURN / SLICES, FULL_TURN / SLICES)
    detections = Detections(np.zeros((0, 2)), None, coverage=coverage)
    return Scan((index + 1) * SLICE_NS, (detections,))


def turn_of(index):
    """Return the scan of a whole turn."""
    return Scan((index + 1) * SLICE_NS, (Detections(np.zeros((0, 2)), None),))


@dataclass(frozen=True)
class Target:
    """The scans that stored a target, and the one that dropped it, if any, by index."""

    stored: list
    dropped: int | None


def lives(scan_of, begins, ends):
    """Return what happens to each target, scan by scan."""
    found = []
    for number in range(len(PLACES)):
        stored, dropped = [begins.get(number, 0)], None
        for index in range(stored[0] + 1, SCANS):
            passed = scan_of is turn_of or index % SLICES == 2 * number
            old = (index - stored[-1]) * SLICE_NS >= FORGOTTEN_NS
            if not passed and not old:
                continue
            if index >= ends.get(number, SCANS):
                dropped = index
                break
            stored.append(index)
        found.append(Target(stored, dropped))
    return found


def survival(since, until_ns):
    """Return the probability that a target survives from a scan until a stamp."""
    return MODEL.modes.classes[0].survival_probability ** (
        (until_ns - (since + 1) * SLICE_NS) / TURN_NS
    )


def filtered_at(targets, stamp_ns, latest):
    """Return the weight of each target that exists at a stamp, given all scans up to one."""
    weights = {}
    for number, target in enumerate(targets):
        known = [index for index in target.stored if index <= latest]
        if known and (target.dropped is None or target.dropped > latest):
            weights[number] = (known[-1] + 1.0) * survival(known[-1], stamp_ns)
    return weights


def smoothed_at(targets, stamp_ns, latest, linked):
    """Return the same at a stamp, given a later scan; with links, by its last mark."""
    weights = {}
    for number, target in enumerate(targets):
        known = [index for index in target.stored if index <= latest]
        dropped = target.dropped is not None and target.dropped <= latest
        past = [index for index in known if (index + 1) * SLICE_NS <= stamp_ns]
        if not past or (dropped and (target.dropped + 1) * SLICE_NS <= stamp_ns):
            continue
        if linked:
            marks = dict.fromkeys(known, known[-1] + NOTED * dropped)
        else:
            marks = {index: index + NOTED * (dropped or index < known[-1]) for index in known}
        before = marks[past[-1]] + 1.0
        if len(past) < len(known):
            after = known[len(past)]
            share = (stamp_ns / SLICE_NS - 1.0 - past[-1]) / (after - past[-1])
            weights[number] = (1.0 - share) * before + share * (marks[after] + 1.0)
        else:
            weights[number] = before * survival(past[-1], stamp_ns)
    return weights


def weights_of(estimates):
    """Return the weight of each target, by the place that it stands at."""
    apart = estimates.position[:, None] - PLACES
    number = np.hypot(apart[..., 0], apart[..., 1]).argmin(axis=1)
    assert len(set(number.tolist())) == len(number)
    np.testing.assert_allclose(estimates.position, PLACES[number], atol=1e-3)
    return dict(zip(number.tolist(), estimates.weight.tolist(), strict=True))


def restored(engine, make):
    """Return another engine that goes on from this one's stored state."""
    other = make()
    other.restore(stored_and_read(engine.snapshot()))
    return other


SCENES = {
    "all stay": ({}, {}),
    "some come and some go": ({1: 9, 2: 12}, {0: 8, 1: 18, 3: 14}),
    # One at once, while the first set still holds the others.
    "all are dropped": ({}, {0: 8, 1: 1, 2: 10, 3: 11}),
}


@pytest.mark.parametrize("scan_of", [slice_of, turn_of], ids=["by slice", "by turn"])
@pytest.mark.parametrize("period_ns", [0, 700_000_000, 3_000_000_000])
@pytest.mark.parametrize("lag", [Lag(0), Lag(1), Lag(5), Lag(0, seconds=2.6)], ids=str)
@pytest.mark.parametrize("scene", SCENES)
def test_estimates_are_those_of_each_target_on_its_own(scan_of, period_ns, lag, scene):
    begins, ends = SCENES[scene]

    def make():
        forward = MarkFilter(MODEL, begins=begins, ends=ends, noted=NOTED)
        return MarkEngine(forward, lag, Schedule(period_ns), rule(LEAST))

    targets, engine, waiting = lives(scan_of, begins, ends), make(), []
    for index in range(SCANS):
        if begins and index % 7 == 3:  # of one scene, as often as a snapshot may be taken
            engine = restored(engine, make)
        scan = scan_of(index)
        due, latest = [scan.stamp_ns], index
        if period_ns:
            latest = index - 1
            due = [t for t in range(0, scan.stamp_ns, period_ns) if t >= index * SLICE_NS]
            due = due if index else []
        step = engine.step(scan)
        assert [estimates.stamp_ns for estimates in step.filtered] == due
        for estimates in step.filtered:
            expected = filtered_at(targets, estimates.stamp_ns, latest)
            assert weights_of(estimates) == pytest.approx(expected, rel=1e-12)
            assert estimates.lag == 0
        waiting += due
        for estimates in step.smoothed:
            check_smoothed(estimates, waiting, targets, index, lag)
        assert not lag.reached(waiting)
        alive = sum(
            target.stored[0] <= index and not (target.dropped or SCANS) <= index
            for target in targets
        )
        assert step.class_mass.tolist() == [alive]
    for estimates in engine.flush():
        check_smoothed(estimates, waiting, targets, SCANS - 1, lag)
    assert not waiting


def check_smoothed(estimates, waiting, targets, latest, lag):
    """Compare estimates of the first stamp that waits, and take that from the list."""
    assert estimates.stamp_ns == waiting[0]
    assert estimates.lag == len(waiting) - 1
    expected = smoothed_at(targets, waiting.pop(0), latest, lag.positive)
    assert weights_of(estimates) == pytest.approx(expected, rel=1e-12)
