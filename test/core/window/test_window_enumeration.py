"""All estimates of a window, against what follows from each target's own scans, one by one.

The reference of a target is an engine that has only the scans which pass it, and only its own
detections. It is smoothed after each of these scans.
"""

from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from four_places import EVERY, MODEL, PLACES, SLICE_NS, SLICES, engine, revolution_of, slice_of
from runs import stored_and_read

from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass

LEAST = 1e-9
SCANS = 12 * SLICES
# Lag of the references: longer than that of any run, whose five stamps are at most 30 scans.
LONGEST = 40


def mixed_of(index, targets=EVERY):
    """Return whole revolutions at first, whose sets then lose one target after the other."""
    return (revolution_of if index < 3 else slice_of)(index, targets)


class Stored(NamedTuple):
    """What one scan of its own left of a target, and what is known then of all its scans."""

    index: int  # Of the scan
    mass: float  # Existence probability, also if it is too small for an estimate
    filtered: float | None  # Existence probability; None without an estimate
    smoothed: dict  # Existence probability of each of its scans, by index


# The first and the last slice in which each target can be seen, if it is not all of them.
SCENES = {
    "some come and some go": {0: (0, 20), 1: (9, 30), 2: (12, SCANS), 3: (0, 24)},
    # One of them after it was seen once.
    "all are dropped": {0: (0, 8), 1: (0, 3), 2: (0, 10), 3: (0, 20)},
}


def seen_in(scene, index):
    return [target for target, (begin, end) in SCENES[scene].items() if begin <= index < end]


@cache
def alone(scan_of, scene, target):
    """Return what each scan that passes a target leaves of it, given these scans alone."""
    of, stored = engine(LONGEST, LEAST), []
    for index in range(SCANS):
        of_targets = scan_of(index).detections[0].coverage is None
        if not (of_targets or index % SLICES == 2 * target):
            continue
        own = {target} & {*seen_in(scene, index)}
        step = of.step(scan_of(index, own))
        (filtered,) = (estimates.weight.tolist() for estimates in step.filtered)
        entries = zip(of._window[::-1], backward_pass(of._window), strict=True)
        smoothed = {
            entry.stamp_ns // SLICE_NS - 1: float(mixture.sums.mass.sum())
            for entry, mixture in reversed(list(entries))
            if mixture.sums.mass.sum() > LEAST
        }
        assert len(filtered) <= 1
        stored.append(Stored(index, float(step.class_mass.sum()), *(filtered or [None]), smoothed))
    return stored


def survival(since, until_ns):
    """Return the probability that a target survives from a scan until a stamp."""
    modes = MODEL.modes
    passed_s = (until_ns - (since + 1) * SLICE_NS) * 1e-9
    return modes.classes[0].survival_probability ** (passed_s / modes.interval_s)


def filtered_at(targets, stamp_ns, latest):
    """Return the weight of each target that exists at a stamp, given all scans up to one."""
    weights = {}
    for number, scans in enumerate(targets):
        known = [each for each in scans if each.index <= latest]
        if known and known[-1].filtered is not None:
            weights[number] = known[-1].filtered * survival(known[-1].index, stamp_ns)
    return weights


def smoothed_at(targets, stamp_ns, latest, linked):
    """Return the same at a stamp, given a later scan; without links, by each scan's own."""
    weights = {}
    for number, scans in enumerate(targets):
        known = [each for each in scans if each.index <= latest]
        if not known:
            continue
        own = {each.index: each.filtered for each in known if each.filtered is not None}
        weight = known[-1].smoothed if linked else own
        past = [each.index for each in known if (each.index + 1) * SLICE_NS <= stamp_ns]
        if not past or past[-1] not in weight:
            continue
        before, later = weight[past[-1]], [index for index in weight if index > past[-1]]
        if later:
            share = (stamp_ns / SLICE_NS - 1.0 - past[-1]) / (later[0] - past[-1])
            weights[number] = (1.0 - share) * before + share * weight[later[0]]
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


def restored(of, make):
    """Return another engine that goes on from this one's stored state."""
    other = make()
    other.restore(stored_and_read(of.snapshot()))
    return other


@pytest.mark.parametrize(
    "scan_of", [slice_of, revolution_of, mixed_of], ids=["by slice", "by revolution", "by both"]
)
@pytest.mark.parametrize("period_ns", [0, 700_000_000, 3_000_000_000])
@pytest.mark.parametrize("lag", [Lag(0), Lag(5), Lag(0, seconds=2.6)], ids=str)
@pytest.mark.parametrize("scene", SCENES)
def test_estimates_are_those_of_each_target_on_its_own(scan_of, period_ns, lag, scene):
    def make():
        return engine(lag, LEAST, period_ns)

    targets = [alone(scan_of, scene, target) for target in EVERY]
    of, waiting = make(), []
    for index in range(SCANS):
        if scan_of is mixed_of and index % 7 == 3:  # As often as a snapshot may be taken
            of = restored(of, make)
        scan = scan_of(index, seen_in(scene, index))
        due, latest = [scan.stamp_ns], index
        if period_ns:
            latest = index - 1
            due = [t for t in range(0, scan.stamp_ns, period_ns) if t >= index * SLICE_NS]
            due = due if index else []
        step = of.step(scan)
        assert [estimates.stamp_ns for estimates in step.filtered] == due
        for estimates in step.filtered:
            expected = filtered_at(targets, estimates.stamp_ns, latest)
            assert weights_of(estimates) == pytest.approx(expected, rel=1e-9)
            assert estimates.lag == 0
        waiting += due
        for estimates in step.smoothed:
            check_smoothed(estimates, waiting, targets, index, lag)
        assert not lag.reached(waiting)
        alive = [[each.mass for each in scans if each.index <= index][-1:] for scans in targets]
        assert step.class_mass.sum() == pytest.approx(sum(map(sum, alive)), rel=1e-9)
    for estimates in of.flush():
        check_smoothed(estimates, waiting, targets, SCANS - 1, lag)
    assert not waiting


def check_smoothed(estimates, waiting, targets, latest, lag):
    """Compare estimates of the first stamp that waits, and take that from the list."""
    assert estimates.stamp_ns == waiting[0]
    assert estimates.lag == len(waiting) - 1
    expected = smoothed_at(targets, waiting.pop(0), latest, lag.positive)
    assert weights_of(estimates) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("scene", SCENES)
def test_the_scenes_have_what_they_are_named_after(scene):
    for target, (begin, end) in SCENES[scene].items():
        weight = [each.filtered for each in alone(slice_of, scene, target)]
        exists = [each is not None for each in weight]
        assert exists.index(True) == -(-(begin - 2 * target) // SLICES)
        assert exists[-1] == (end == SCANS)
        assert sum(before and not after for before, after in pairwise(exists)) == (end < SCANS)
