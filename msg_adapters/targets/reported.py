"""What self-reports say of estimates, as columns of clouds and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.types import UNKNOWN, Reported
from phd_jdtc_ros.core.types.reports import ALARM, NAME_SIZE, REASONS, SPACES

# Stands for no address and no type in the unsigned columns.
NONE = 2**32 - 1
FLOATS = (
    *("dark", "silent", "doubtful", "owned", "offset_ahead", "offset_left"),
    *("heard_age", "reason_age"),
)
WHOLE = ("source", "source_space", "source_type", "alone", "reason")
NAME = "source_name"
# Colours of dark targets and of doubtful sources, which no class has.
DARK, DOUBTFUL = "#000000", "#ff00ff"


def columns_of(reports: Reported, stamp_ns: int) -> dict[str, npt.NDArray[Any]]:
    """Return columns by field name: FLOAT32 `FLOATS`, UINT32 `WHOLE`, and the name's bytes.

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
        "source": np.where(reports.address == UNKNOWN, NONE, reports.address),
        "source_space": reports.space,
        "source_type": np.where(reports.type == UNKNOWN, NONE, reports.type),
        "alone": reports.alone,
        "reason": reports.reason,
        NAME: reports.name.astype(np.uint8),
    }


def said_of(reports: Reported, row: int, stamp_ns: int) -> dict[str, Any]:
    """Return what is said of one estimate as properties; unknown numbers are None."""
    value = {"owned": reports.owned, "dark": reports.dark, "silent": reports.silent}
    value["doubtful"] = reports.doubtful
    known = {name: float(column[row]) for name, column in value.items()}
    return {
        "source": reports.source_text(row),
        **{name: None if np.isnan(each) else round(each, 4) for name, each in known.items()},
        "alone": bool(reports.alone[row]),
        "reason": reports.reason_text(row, stamp_ns),
    }


def colour_of(reports: Reported, row: int, usual: str) -> str:
    """Return the colour of an estimate: that of dark targets or doubtful sources, or the usual."""
    if reports.dark[row] > ALARM:
        return DARK
    return DOUBTFUL if reports.doubtful[row] > ALARM else usual


def of_columns(columns: Mapping[str, npt.NDArray[Any]], stamp_ns: int) -> Reported:
    """Return what the columns of a cloud say; reasons and spaces that do not exist are none."""
    value = {name: columns[name].astype(np.float64) for name in FLOATS}
    whole = {name: columns[name].astype(np.int64) for name in WHOLE}
    probability = {name: _probability(value[name]) for name in FLOATS[:4]}
    for name in ("dark", "owned"):
        probability[name] = np.nan_to_num(probability[name], nan=0.0)
    address, kind = (
        np.where(whole[name] == NONE, UNKNOWN, whole[name]) for name in ("source", "source_type")
    )
    letters, size = columns.get(NAME), len(address)
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
