"""Clouds of self-reports, and what estimates say of them in clouds."""

from __future__ import annotations

import numpy as np
import pytest
from harbour import configured, turns

from msg_adapters.encoding import RejectedMessageError, point_cloud
from msg_adapters.incoming import self_reports
from msg_adapters.targets import estimates
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.configuration.parameters.reports import ReportsParameters
from phd_jdtc_ros.core.types.reports import text_of
from phd_jdtc_ros.earth import SystemPlane

STAMP_NS = 1_700_000_000_250_000_000
OWN = ReportsParameters(name="ais", plane=SystemPlane([54.0, 10.0, 0.0]))


def cloud(**more):
    name = np.zeros((2, 20), dtype=np.uint8)
    name[0, :4] = list(b"ANNA")
    columns = {
        "latitude": np.array([54.001, 54.002]),
        "longitude": np.array([10.0, 10.0]),
        "time": np.full(2, STAMP_NS * 1e-9 - 1.0),
        "std": np.array([4.0, np.nan]),
        "address": np.array([211000001, 2**32 - 1]),
        "name": name,
        **more,
    }
    return point_cloud.encode(STAMP_NS, "", columns, ("latitude", "longitude", "time"))


def test_from_msg_reads_places_names_and_times():
    found = self_reports.from_msg(cloud(), OWN)
    assert not found.dropped
    np.testing.assert_allclose(found.reports.position[:, 1], [111.3, 222.6], atol=0.5)
    assert text_of(found.reports.name[0]) == "ANNA"
    np.testing.assert_allclose(found.reports.time_ns, STAMP_NS - 1_000_000_000, atol=1000)
    assert found.reports.address.tolist() == [211000001, -1]


def test_from_msg_refuses_latitudes_without_an_origin():
    with pytest.raises(RejectedMessageError, match="world_origin"):
        self_reports.from_msg(cloud(), ReportsParameters(name="ais"))


def test_from_msg_refuses_a_name_of_another_size():
    with pytest.raises(RejectedMessageError, match="must be one of 20u1"):
        self_reports.from_msg(cloud(name=np.zeros((2, 7), dtype=np.uint8)), OWN)


def test_estimates_with_reports_survive_a_cloud():
    pipeline, found = new_pipeline(configured()), None
    for turn in turns(1, 60.0):
        pipeline.add_reports(0, turn.reports)
        for event in pipeline.add(0, turn.stamp_ns, turn.plots):
            found = event.step.filtered[-1]
    again = estimates.from_msg(estimates.to_msg(found, "map"))
    for name in ("address", "space", "alone", "reason", "type", "name"):
        np.testing.assert_array_equal(getattr(again.reports, name), getattr(found.reports, name))
    for name in ("owned", "dark", "silent", "doubtful", "offset"):
        np.testing.assert_allclose(
            getattr(again.reports, name), getattr(found.reports, name), rtol=1e-5, atol=1e-6
        )
    np.testing.assert_allclose(again.reports.heard_ns, found.reports.heard_ns, atol=2e6)
