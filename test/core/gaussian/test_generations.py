# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Going back by generations of targets gives what going back scan by scan gives."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from sweep import ROTATION_S, configuration, scans

from phd_jdtc_ros.core import backward
from phd_jdtc_ros.core.engines import new_engine
from phd_jdtc_ros.core.gaussian import smoother
from phd_jdtc_ros.core.gaussian.generations import generations, is_chain

SECTORED = {"engine": "gaussian", "estimates_period_s": ROTATION_S, "lag": 4}


def window(turns, least_existence=None):
    """Return what an engine holds after some turns by sector."""
    engine = new_engine(configuration(SECTORED))
    if least_existence is not None:
        bounds = replace(engine.forward.bounds, least_existence=least_existence)
        engine.forward.bounds = bounds
    for scan in scans(turns):
        engine.step(scan)
    return engine._window


def scan_by_scan(entries):
    """Return the smoothed mixtures, oldest first, each scan's targets on their own."""

    def hear(filtered, told):
        columns = [column.copy() for column in (filtered.weight, filtered.mean)]
        columns.append(filtered.covariance.copy())
        for part in told:
            rows = np.arange(len(filtered)) if part.rows is None else part.rows
            taken = np.arange(len(part.message.weight))[part.part]
            message = smoother.Later(
                part.message.moves.take(taken),
                *(getattr(part.message, name)[taken] for name in ("weight", "mean", "covariance")),
            )
            own = smoother._with_hindsight(filtered.take(rows), message)
            for column, name in zip(columns, ("weight", "mean", "covariance"), strict=True):
                column[rows] = getattr(own, name)
        return filtered.told(*columns)

    return list(backward.smoothed_sets(entries, smoother._before_update, hear))[::-1]


@pytest.mark.parametrize("turns", [3, 7])
@pytest.mark.parametrize("existence", [None, 0.2], ids=["all", "doubtful ones dropped"])
def test_targets_go_back_together_as_scan_by_scan(turns, existence):
    entries = window(turns, existence)
    assert not is_chain(entries)
    together = smoother.backward_pass(entries)[::-1]
    for own, expected in zip(together, scan_by_scan(entries), strict=True):
        np.testing.assert_array_equal(own.origin, expected.origin)
        np.testing.assert_allclose(own.weight, expected.weight, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(own.mean, expected.mean, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(own.covariance, expected.covariance, rtol=1e-6, atol=1e-6)


def test_generations_hold_every_hypothesis_once():
    entries = window(7)
    parts = generations(entries)
    rows = np.concatenate([part.rows for part in parts])
    assert sorted(rows.tolist()) == list(range(sum(len(entry.stored) for entry in entries)))
    assert len(parts) < len(entries) / 4
    for part, before in itertools.pairwise(parts):
        assert len(part.link.moves.change) == len(before.stored)
        assert set(part.stored.origin[part.link.ancestry.child]) <= set(before.stored.origin)


def test_window_whose_sources_have_left_is_what_was_filtered():
    last = window(5)[-1:]
    (alone,) = smoother.backward_pass(last)
    np.testing.assert_array_equal(alone.weight, last[0].stored.weight)
