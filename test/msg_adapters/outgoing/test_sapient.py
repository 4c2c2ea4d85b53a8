"""Messages of SAPIENT as an independent model of the standard validates and reads them."""

import math
import sys
import uuid
from dataclasses import replace

import numpy as np
import pytest
from samples import estimates
from sapient_msg.bsi_flex_335_v2_0.sapient_message_pb2 import SapientMessage

if sys.version_info < (3, 11):
    pytest.skip("sapient-pydantic cannot be imported before Python 3.11", allow_module_level=True)
from sapient_msg_pydantic.bsi_flex_335_v2_0 import sapient_message as model

from msg_adapters.outgoing import sapient
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.earth import SystemPlane

RUN, STAMP_NS = uuid.UUID(int=7, version=4), 1_700_000_000_500_000_000
NAMES = ("boat & barge", "plane")


def read(sent):
    """Return the messages as the model validates them, each behind its length."""
    found = []
    for each in sent:
        assert int.from_bytes(each[:4], "little") == len(each) - 4
        found.append(model.SapientMessage.from_pb2(SapientMessage.FromString(each[4:])))
    return found


def at(*states, **changes):
    state = np.zeros((len(states), 5))
    state[:, :4] = states
    given = replace(estimates(len(states)), stamp_ns=STAMP_NS, state=state)
    return replace(given, track_id=np.arange(1, len(states) + 1), **changes)


def reports(given, plane, manual=None):
    return read(sapient.reports(given, plane, NAMES, RUN, manual or Manual()))


def test_registration_is_valid_and_names_the_classes():
    (found,) = read([sapient.registration(STAMP_NS, RUN, NAMES, 4.0)])
    assert str(found.node_id) == str(RUN)
    (mode,) = found.registration.mode_definition
    (kinds,) = mode.detection_definition[0].detection_class_definition
    assert tuple(kind.type for kind in kinds.class_definition) == NAMES
    assert found.registration.status_definition.status_interval.value == 4.0


def test_reports_have_place_errors_velocity_and_classes():
    plane = SystemPlane((52.3, 4.8, 0.0))
    status, first, second = reports(at((0.0, 30.0, 0.0, 40.0), (0.0, 0.0, 1e4, 0.0)), plane)
    assert status.status_report.mode == "tracking"
    report = first.detection_report
    assert (report.location.x, report.location.y) == pytest.approx((4.8, 52.3), abs=1e-7)
    assert second.detection_report.location.y == pytest.approx(52.3 + 1e4 / 111_268, abs=1e-4)
    velocity = report.enu_velocity
    assert (velocity.east_rate, velocity.north_rate) == pytest.approx((30.0, 40.0), rel=1e-3)
    assert [kind.type for kind in report.classification] == [*NAMES]
    variance = at((0.0,) * 4).position_covariance[0, 1, 1]
    assert report.location.y_error * 111_195 == pytest.approx(math.sqrt(variance), rel=1e-3)


def test_objects_keep_their_identifiers_and_reports_do_not():
    plane = SystemPlane((52.3, 4.8, 0.0))
    (_, now), (_, later) = (
        reports(at((0.0, 0.0, 0.0, 0.0)).changed(stamp_ns=STAMP_NS + k), plane) for k in (0, 10**9)
    )
    assert now.detection_report.object_id == later.detection_report.object_id
    assert now.detection_report.report_id != later.detection_report.report_id


def test_name_of_the_operator_is_the_id():
    plane = SystemPlane((52.3, 4.8, 0.0))
    (_, found) = reports(at((0.0,) * 4), plane, Manual(names={1: "Aurora"}))
    assert found.detection_report.id == "Aurora"
