"""Estimates to and from point clouds, with what self-reports say of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import count, takewhile
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.columns import identities
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.state_space import OMEGA, PLANAR, SPATIAL, VX, VY, X, Y
from phd_jdtc_ros.core.types import (
    COASTING,
    CONFIRMED,
    SENSORS,
    UNKNOWN,
    Attributes,
    Estimates,
    Reported,
)
from phd_jdtc_ros.core.types.reports import NAME_SIZE, REASONS, SPACES

from ..encoding import RejectedMessageError, point_cloud, stamps
from . import vertical

_UPPER = tuple(zip(*np.triu_indices(len(PLANAR)), strict=True))
_COVARIANCE = [f"cov_{row}{column}" for row, column in _UPPER]
# Indices of each covariance of height and climb rate, by field.
_VERTICAL = {"cov_zz": (0, 0), "cov_zvz": (0, 1), "cov_vzvz": (1, 1)}
# Covariances of the planar axes with height and climb rate, by field.
_CROSS = {
    f"cov_{one}{other}": (row, column)
    for row, one in enumerate(PLANAR.axes)
    for other, column in zip(SPATIAL.axes[len(PLANAR) :], SPATIAL.vertical, strict=True)
}
_IDENTITIES = ("code", "address")
_AGES = tuple(f"age_{sensor}" for sensor in SENSORS)
PRESSURE = "pressure_altitude"
OWNER, MEMBER = "owner", "member_"
# Columns of what self-reports say, with unknown numbers, and whole ones.
_SAID = (
    *("dark", "silent", "doubtful", "owned", "offset_ahead", "offset_left"),
    *("heard_age", "reason_age"),
)
_SAID_WHOLE, _NAME = ("source", "source_space", "source_type", "alone", "reason"), "source_name"
_STATE = (("x", X), ("y", Y), ("vx", VX), ("vy", VY), ("omega", OMEGA))


def to_msg(estimates: Estimates, frame: str) -> PointCloud2:
    """Encode one set of estimates, empty or not.

    The fields are ``x y z vx vy vz omega weight`` (FLOAT32), ``track_id class_id lag`` (UINT32),
    ``p_class_0 ...``, the 15 terms ``cov_00 cov_01 ... cov_44`` of the covariance's upper triangle
    in the order x, vx, y, vy, omega (FLOAT32), and ``state`` (UINT32): 0 tentative, 1 confirmed, 2
    coasting.

    Estimates with attributes also have FLOAT32 ``cov_zz cov_zvz cov_vzvz`` and UINT32 ``code
    address``. Unknown heights are 0 with NaN covariances; unknown identities are 4294967295. If a
    radar reports the kind of sensor, FLOAT32 ``age_psr age_ssr age_mds`` follow: the time since
    each kind of sensor last detected the target, seconds; NaN for never.

    Estimates in space end with FLOAT32 ``cov_xz cov_xvz cov_vxz ... cov_omegavz``, the ten
    covariances of the plane's axes with height and climb rate, and ``pressure_altitude``, the
    altitude in the standard atmosphere; NaN for an unknown one.

    With receivers of self-reports the columns of `_said_columns` follow. Estimates of several
    trackers end with UINT32 ``owner member_0 member_1 ...``, see `Estimates.members`.
    """
    return point_cloud.encode(estimates.stamp_ns, frame, _columns_of(estimates))


def to_cdr(estimates: Estimates, frame: str) -> bytes:
    """Return the serialised cloud of `to_msg`."""
    return point_cloud.to_cdr(estimates.stamp_ns, frame, _columns_of(estimates))


def _columns_of(estimates: Estimates) -> dict[str, npt.NDArray[Any]]:
    state, known = estimates.state, estimates.attributes
    height = vertical.states(estimates)
    columns = {
        "x": state[:, X],
        "y": state[:, Y],
        "z": height[:, 0],
        "vx": state[:, VX],
        "vy": state[:, VY],
        "vz": height[:, 1],
        "omega": state[:, OMEGA],
        "weight": estimates.weight,
        "track_id": estimates.track_id,
        "class_id": estimates.class_id,
        "lag": np.full(len(estimates), estimates.lag),
    }
    for index in range(estimates.class_probability.shape[1]):
        columns[f"p_class_{index}"] = estimates.class_probability[:, index]
    for name, (row, column) in zip(_COVARIANCE, _UPPER, strict=True):
        columns[name] = estimates.covariance[:, row, column]
    # Later fields follow the older ones, so that readers with fixed offsets keep working.
    columns["state"] = estimates.track_state
    if known is not None:
        for name, (one, other) in _VERTICAL.items():
            columns[name] = known.height_covariance[:, one, other]
        columns["code"] = identities.encode(known.code, len(estimates))
        columns["address"] = identities.encode(known.address, len(estimates))
        if known.seen_ns is not None:
            columns |= dict(zip(_AGES, known.ages_s(estimates.stamp_ns).T, strict=True))
        if estimates.space.vertical:
            unknown = np.isnan(known.height[:, 0])
            for name, (one, other) in _CROSS.items():
                columns[name] = np.where(unknown, np.nan, estimates.covariance[:, one, other])
            columns[PRESSURE] = known.height[:, 0] + estimates.pressure_above
    if estimates.reports is not None:
        columns |= _said_columns(estimates.reports, estimates.stamp_ns)
    if estimates.members is not None:
        # Numbers that are unique over all series of a tracker are beyond 32 bits.
        owner, *members = (estimates.members % 2**32).T
        columns |= {OWNER: owner, **{f"{MEMBER}{k}": own for k, own in enumerate(members)}}
    return columns


def class_count(cloud: PointCloud2) -> int:
    """Return the number of classes in a cloud of estimates."""
    return sum(name.startswith("p_class_") for name in point_cloud.field_names(cloud))


def from_msg(cloud: PointCloud2) -> Estimates:
    """Decode the estimates of a cloud; the lag of an empty cloud is 0.

    All tracks are confirmed if the cloud has no field ``state``.

    Raise `RejectedMessageError`; see `point_cloud.decode` and `stamps.of_header`.
    """
    unknown_as_nan = ("z", "vz", *_VERTICAL, *_CROSS, *_AGES, PRESSURE)
    classes = [f"p_class_{index}" for index in range(class_count(cloud))]
    if not classes:
        raise RejectedMessageError("schema", "field 'p_class_0' is missing")
    floats = [name for name, _ in _STATE] + ["weight", *classes, *_COVARIANCE]
    whole = ["track_id", "class_id", "lag"]
    # Clouds recorded before the field existed have confirmed tracks only.
    if "state" in point_cloud.field_names(cloud):
        whole.append("state")
    attributed = "code" in point_cloud.field_names(cloud)
    if attributed:
        floats += ["z", "vz", *_VERTICAL]
        whole += _IDENTITIES
        if _AGES[0] in point_cloud.field_names(cloud):
            floats += _AGES
    in_space = attributed and {*_CROSS} <= {*point_cloud.field_names(cloud)}
    if in_space:
        floats += _CROSS
        floats += {PRESSURE} & {*point_cloud.field_names(cloud)}
    told = {*_SAID, *_SAID_WHOLE} <= {*point_cloud.field_names(cloud)}
    if told:
        floats += _SAID
        whole += _SAID_WHOLE
    members = _member_names(point_cloud.field_names(cloud))
    whole += members
    wanted: dict[str, tuple[str, ...]] = dict.fromkeys(floats, point_cloud.FLOATS)
    wanted |= dict.fromkeys(whole, point_cloud.UNSIGNED)
    if told and _NAME in point_cloud.field_names(cloud):
        wanted[_NAME] = (f"{NAME_SIZE}u1",)
    columns = point_cloud.decode(cloud, wanted)
    stamp_ns = stamps.of_header(cloud.header)
    known = _attributes(columns, stamp_ns) if attributed else None
    point_cloud.require_finite(
        {n: column for n, column in columns.items() if n not in unknown_as_nan + _SAID}
    )
    size = len(columns["x"])
    track_state = columns.get("state", np.full(size, CONFIRMED)).astype(np.int64)
    if (track_state > COASTING).any():
        raise RejectedMessageError(
            "schema", f"state is {track_state.max()}, must be at most {COASTING}"
        )
    if (columns["class_id"] >= len(classes)).any():
        raise RejectedMessageError(
            "schema", f"class_id is {columns['class_id'].max()}, must be below {len(classes)}"
        )
    space = SPATIAL if in_space else PLANAR
    state = np.zeros((size, len(space)))
    for name, index in _STATE:
        state[:, index] = columns[name]
    covariance = np.zeros((size, len(space), len(space)))
    for name, (row, column) in zip(_COVARIANCE, _UPPER, strict=True):
        covariance[:, row, column] = covariance[:, column, row] = columns[name]
    if in_space and known is not None:
        _fill_space(state, covariance, known, columns)
    return Estimates(
        stamp_ns=stamp_ns,
        lag=int(columns["lag"][0]) if size else 0,
        state=state,
        covariance=covariance,
        weight=columns["weight"].astype(np.float64),
        class_probability=np.stack([columns[name] for name in classes], axis=1),
        class_id=columns["class_id"].astype(np.int64),
        track_id=columns["track_id"].astype(np.int64),
        space=space,
        track_state=track_state,
        attributes=known,
        pressure_above=_pressure_above(columns, known),
        reports=_said(columns, stamp_ns) if told else None,
        members=_members(columns, members),
    )


def _member_names(fields: Sequence[str]) -> list[str]:
    """Return the fields of `Estimates.members` in their order; none without an owner."""
    if OWNER not in fields:
        return []
    return [OWNER, *takewhile(fields.__contains__, (f"{MEMBER}{k}" for k in count()))]


def _members(columns: Mapping[str, npt.NDArray[Any]], names: Sequence[str]) -> IntArray | None:
    """Return `Estimates.members`, None if the cloud has none."""
    if not names:
        return None
    if (columns[OWNER] >= len(names) - 1).any():
        raise RejectedMessageError(
            "schema", f"owner is {columns[OWNER].max()}, must be below {len(names) - 1}"
        )
    return np.stack([columns[name] for name in names], axis=1).astype(np.int64)


def _pressure_above(columns: Mapping[str, npt.NDArray[Any]], known: Attributes | None) -> float:
    """Return the mean difference of pressure altitudes from heights; NaN if it is not known."""
    if known is None or PRESSURE not in columns:
        return math.nan
    above = columns[PRESSURE].astype(np.float64) - known.height[:, 0]
    finite = point_cloud.finite(above)
    return float(above[finite].mean()) if finite.any() else math.nan


def _fill_space(
    state: FloatArray,
    covariance: FloatArray,
    known: Attributes,
    columns: Mapping[str, npt.NDArray[Any]],
) -> None:
    """Write height and climb rate with their covariances; 0 where the height is unknown."""
    axes = np.array(SPATIAL.vertical)
    state[:, axes] = vertical.known_or_zero(known.height)
    covariance[:, axes[:, None], axes] = vertical.known_or_zero(known.height_covariance)
    unknown = np.isnan(known.height[:, 0])
    for name, (row, column) in _CROSS.items():
        cross = np.where(unknown, 0.0, vertical.known_or_zero(columns[name].astype(np.float64)))
        covariance[:, row, column] = covariance[:, column, row] = cross


def _attributes(columns: Mapping[str, npt.NDArray[Any]], stamp_ns: int) -> Attributes:
    """Return the heights and identities of a cloud, unknown if their columns are missing."""
    height = np.stack([columns["z"], columns["vz"]], axis=1).astype(np.float64)
    covariance = np.zeros((len(height), 2, 2))
    for name, (row, column) in _VERTICAL.items():
        covariance[:, row, column] = covariance[:, column, row] = columns[name]
    finite = point_cloud.finite
    unknown = ~(finite(covariance).all(axis=(1, 2)) & finite(height).all(axis=1))
    height[unknown], covariance[unknown] = np.nan, np.nan
    every = np.ones(len(height), dtype=np.bool_)
    sent = {name: columns[name].astype(np.float64) for name in _IDENTITIES}
    found, _ = identities.read(sent, every)
    return Attributes(height, covariance, **found, seen_ns=_detection_times(columns, stamp_ns))


def _detection_times(columns: Mapping[str, npt.NDArray[Any]], stamp_ns: int) -> IntArray | None:
    """Return the times of the last detection by each kind of sensor, None without ages."""
    if _AGES[0] not in columns:
        return None
    ages = np.stack([columns[name] for name in _AGES], axis=1).astype(np.float64)
    # A negative age means never, and an infinite one does not fit a stamp.
    known = np.isfinite(ages) & (ages >= 0.0) & (ages * 1e9 <= stamp_ns)
    seen_ns = stamp_ns - np.rint(np.where(known, ages, 0.0) * 1e9).astype(np.int64)
    return np.where(known, seen_ns, UNKNOWN)


def _said_columns(reports: Reported, stamp_ns: int) -> dict[str, npt.NDArray[Any]]:
    """Return columns by field name: FLOAT32, UINT32 and the name's bytes.

    An unknown number is NaN, and an unknown source or type 4294967295. Ages are in seconds.
    """
    return {
        "dark": reports.dark,
        "silent": reports.silent,
        "doubtful": reports.doubtful,
        "owned": reports.owned,
        "offset_ahead": reports.offset[:, 0],
        "offset_left": reports.offset[:, 1],
        "heard_age": _age(reports.heard_ns, stamp_ns),
        "reason_age": _age(reports.since_ns, stamp_ns),
        "source": np.where(reports.address == UNKNOWN, identities.NONE, reports.address),
        "source_space": reports.space,
        "source_type": np.where(reports.type == UNKNOWN, identities.NONE, reports.type),
        "alone": reports.alone,
        "reason": reports.reason,
        _NAME: reports.name.astype(np.uint8),
    }


def _said(columns: Mapping[str, npt.NDArray[Any]], stamp_ns: int) -> Reported:
    """Return what the columns of a cloud say; reasons and spaces that do not exist are none."""
    value = {name: columns[name].astype(np.float64) for name in _SAID}
    whole = {name: columns[name].astype(np.int64) for name in _SAID_WHOLE}
    probability = {name: _probability(value[name]) for name in _SAID[:4]}
    for name in ("dark", "owned"):
        probability[name] = np.nan_to_num(probability[name], nan=0.0)
    address, kind = (
        np.where(whole[name] == identities.NONE, UNKNOWN, whole[name])
        for name in ("source", "source_type")
    )
    letters, size = columns.get(_NAME), len(address)
    if letters is None:
        letters = np.zeros((size, NAME_SIZE))
    return Reported(
        address=address,
        space=_below(whole["source_space"], len(SPACES)),
        name=letters.astype(np.int64),
        type=kind,
        alone=np.minimum(whole["alone"], 1),
        offset=np.stack([value["offset_ahead"], value["offset_left"]], axis=1),
        reason=_below(whole["reason"], len(REASONS)),
        since_ns=_time(value["reason_age"], stamp_ns),
        heard_ns=_time(value["heard_age"], stamp_ns),
        **probability,
    )


def _age(time_ns: IntArray, stamp_ns: int) -> FloatArray:
    return np.where(time_ns > 0, (stamp_ns - time_ns) * 1e-9, np.nan)


def _time(age_s: FloatArray, stamp_ns: int) -> IntArray:
    known = np.isfinite(age_s) & (np.abs(age_s) * 1e9 < stamp_ns)
    return np.where(known, stamp_ns - np.rint(np.where(known, age_s, 0.0) * 1e9), 0).astype(
        np.int64
    )


def _probability(value: FloatArray) -> FloatArray:
    return np.where((value >= 0.0) & (value <= 1.0), value, np.nan)


def _below(value: IntArray, end: int) -> IntArray:
    return np.where(value < end, value, 0)
