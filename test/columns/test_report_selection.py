"""Self-reports of columns: units, senses, and what is no report."""

from __future__ import annotations

import numpy as np
import pytest

from phd_jdtc_ros.columns.report_selection import select
from phd_jdtc_ros.configuration.parameters.reports import ReportsParameters
from phd_jdtc_ros.core.types import UNKNOWN
from phd_jdtc_ros.core.types.reports import ICAO, MMSI, text_of
from phd_jdtc_ros.earth import SystemPlane

STAMP_NS = 1_700_000_000_000_000_000
PLANE = SystemPlane([54.0, 10.0, 20.0])
OWN = ReportsParameters(name="ais", plane=PLANE)


def told(**columns):
    count = len(next(iter(columns.values())))
    place = {"latitude": np.full(count, 54.0), "longitude": np.full(count, 10.0)}
    return select(STAMP_NS, OWN, {**place, **{n: np.asarray(c) for n, c in columns.items()}})


def test_select_turns_latitudes_courses_and_heights_into_the_plane():
    found = told(
        latitude=[54.0, 54.01],
        longitude=[10.0, 10.0],
        speed=[5.0, 5.0],
        course=[0.0, 90.0],
        heading=[90.0, 511.0],
        height=[120.0, np.nan],
    ).reports
    np.testing.assert_allclose(found.position[0], [0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(found.position[1], [0.0, 1113.0], atol=2.0)
    np.testing.assert_allclose(found.velocity, [[0.0, 5.0], [5.0, 0.0]], atol=1e-3)
    assert found.heading[0] == pytest.approx(0.0, abs=1e-3)
    assert np.isnan(found.heading[1])
    assert found.height[0] == 100.0
    assert found.time_ns.tolist() == [STAMP_NS, STAMP_NS]


def test_select_drops_what_has_no_place_time_or_address_and_counts_it():
    found = told(
        latitude=[91.0, 54.0, 54.0, np.nan, 54.0, 54.0],
        longitude=[181.0, 10.0, 10.0, 10.0, np.inf, 10.0],
        address=[1.0, 0.0, 2.0**32, 5.0, 6.0, 7.0],
        time=[1.7e9, 1.7e9, 1.7e9, 1.7e9, 1.7e9, -5.0],
    )
    assert len(found.reports) == 0
    assert found.dropped == {"place": 3, "address": 2, "time": 1}


def test_select_leaves_out_what_is_no_craft_by_its_mmsi_and_counts_it():
    coast, aircraft, aid = 2_110_001, 111_211_001, 992_111_001
    ship, group, tender, handheld, beacon = 211_000_001, 21_100_001, 982_110_001, 821_100_001, 972e6
    wrongly_set = 111_111_111, 123_456_789, 999_999_999, 3
    craft = [ship, group, tender, handheld, beacon, *wrongly_set]
    found = told(address=[coast, aircraft, aid, *craft], space=[MMSI] * (3 + len(craft)))
    assert found.reports.address.tolist() == craft
    assert found.dropped == {"coast_station": 1, "aircraft": 1, "aid_to_navigation": 1}
    # The same number of another network is the address of an aircraft.
    assert told(address=[coast], space=[ICAO]).reports.address.tolist() == [coast]


def test_select_keeps_unknown_numbers_unknown():
    found = told(
        address=[4294967295.0, 3.0],
        type=[0.0, 70.0],
        accurate=[255.0, 1.0],
        space=[0.0, 1.0],
        std=[np.nan, 5.0],
        speed=[102.3e3, np.nan],
        course=[3.0, 3.0],
    ).reports
    assert found.address.tolist() == [UNKNOWN, 3]
    assert found.type.tolist() == [UNKNOWN, 70]
    assert found.accurate.tolist() == [UNKNOWN, 1]
    assert found.space.tolist() == [MMSI, ICAO]
    assert np.isnan(found.covariance[0]).all()
    np.testing.assert_allclose(found.covariance[1], 25.0 * np.eye(2))
    assert np.isnan(found.velocity).all()


def test_select_without_an_origin_has_no_place_for_latitudes():
    columns = {"latitude": np.array([54.0]), "longitude": np.array([10.0])}
    found = select(STAMP_NS, ReportsParameters(name="ais"), columns)
    assert found.dropped == {"place": 1}


def test_names_are_letters_alone():
    name = np.zeros((1, 20), dtype=np.uint8)
    name[0, :6] = list(b"EVER\x1b]")
    assert text_of(told(name=name).reports.name[0]) == "EVER]"
    assert text_of(told(name=np.array(["ÜBER ALLES, a name of many letters"])).reports.name[0]) == (
        "?BER ALLES, a name o"
    )
