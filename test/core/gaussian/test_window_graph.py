"""Going back by generations of targets gives what going back scan by scan gives."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from sweep import ROTATION_S, START_NS, configuration, scans

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian import smoother
from phd_jdtc_ros.core.gaussian.window_graph import generations, is_chain
from phd_jdtc_ros.core.window import backward_pass

SECTORED = {"engine": "gaussian", "estimates_period_s": ROTATION_S, "lag": 4}


def window(turns, least_existence=None, wide_turns=0):
    """Return what an engine holds after some turns by sector, the first of them by half."""
    engine = new_engine(configuration(SECTORED))
    if least_existence is not None:
        bounds = replace(engine.forward.bounds, least_existence=least_existence)
        engine.forward.bounds = bounds
    narrow_ns = START_NS + round(wide_turns * ROTATION_S * 1e9)
    for scan in scans(turns, sectors=2):
        if scan.stamp_ns < narrow_ns:
            engine.step(scan)
    for scan in scans(turns):
        if scan.stamp_ns > narrow_ns:
            engine.step(scan)
    return engine._window


def scan_by_scan(entries):
    """Return the smoothed mixtures, oldest first, each scan's targets on their own."""

    def receive(filtered, told):
        columns = [column.copy() for column in (filtered.weight, filtered.mean)]
        columns.append(filtered.covariance.copy())
        for part in told:
            rows = np.arange(len(filtered)) if part.rows is None else part.rows
            taken = np.arange(len(part.content.weight))[part.part]
            message = smoother.Later(
                part.content.moves.take(taken),
                *(getattr(part.content, name)[taken] for name in ("weight", "mean", "covariance")),
            )
            own = smoother._with_hindsight(filtered.take(rows), message)
            for column, name in zip(columns, ("weight", "mean", "covariance"), strict=True):
                column[rows] = getattr(own, name)
        return filtered.with_gaussians(*columns)

    return list(backward_pass.smoothed_sets(entries, smoother._before_update, receive))[::-1]


def check_as_scan_by_scan(entries):
    together = smoother.backward_pass(entries)[::-1]
    for own, expected in zip(together, scan_by_scan(entries), strict=True):
        np.testing.assert_array_equal(own.row_label, expected.row_label)
        np.testing.assert_allclose(own.weight, expected.weight, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(own.mean, expected.mean, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(own.covariance, expected.covariance, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("turns", "wide_turns"), [(3, 0), (7, 0), (5, 3)])
@pytest.mark.parametrize("existence", [None, 0.2], ids=["all", "doubtful ones dropped"])
def test_targets_go_back_together_as_scan_by_scan(turns, wide_turns, existence):
    entries = window(turns, existence, wide_turns)
    assert not is_chain(entries)
    parts = [source.rows is not None for entry in entries for source in entry.sources]
    assert any(parts) == (wide_turns > 0)
    check_as_scan_by_scan(entries)


def test_scans_whose_sources_have_left_go_back_as_far_as_the_others():
    entries = window(5, wide_turns=3)
    for first in range(1, len(entries)):
        check_as_scan_by_scan(entries[first:])


def test_window_without_links_is_what_was_filtered():
    entries = [entry.unlinked for entry in window(4)]
    for found, entry in zip(smoother.backward_pass(entries)[::-1], entries, strict=True):
        np.testing.assert_array_equal(found.weight, entry.stored.weight)
        np.testing.assert_array_equal(found.mean, entry.stored.mean)


def test_window_of_no_targets_has_none():
    engine = new_engine(configuration(SECTORED))
    for scan in scans(1):
        nothing = replace(scan.detections[0], measurement=np.zeros((0, 2)), time_s=np.zeros(0))
        engine.step(replace(scan, detections=(nothing,)))
    entries = engine._window
    found = smoother.backward_pass([entries[0], *entries[2:]])
    assert [len(mixture) for mixture in found] == [0] * (len(entries) - 1)


def test_scans_of_whole_turns_are_a_chain():
    engine = new_engine(configuration({**SECTORED, "estimates_period_s": 0.0}))
    for scan in scans(4, sectors=1):
        engine.step(replace(scan, detections=(replace(scan.detections[0], coverage=None),)))
    entries = engine._window
    assert len(entries) == 4
    assert is_chain(entries)
    assert not is_chain([entries[0], *entries[2:]])
    check_as_scan_by_scan(entries)


def test_generations_hold_every_hypothesis_once():
    entries = window(7)
    parts = generations(entries)
    rows = np.concatenate([part.rows for part in parts])
    assert sorted(rows.tolist()) == list(range(sum(len(entry.stored) for entry in entries)))
    assert len(parts) < len(entries) / 4
    for part, before in itertools.pairwise(parts):
        assert len(part.link.moves.change) == len(before.stored)
        assert set(part.stored.row_label[part.link.ancestry.child]) <= set(before.stored.row_label)


def test_window_whose_sources_have_left_is_what_was_filtered():
    last = window(5)[-1:]
    (alone,) = smoother.backward_pass(last)
    np.testing.assert_array_equal(alone.weight, last[0].stored.weight)
