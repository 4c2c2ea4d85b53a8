"""What a live picture shows, as JSON: the head, which changes seldom, and the updates."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from msg_adapters.targets import vertical
from msg_adapters.targets.markers import class_colour
from phd_jdtc_ros.core.conflicts.model import Conflicts
from phd_jdtc_ros.core.types import FILTERED, Estimates
from phd_jdtc_ros.report.page.picture import (
    AXIS_STEPS,
    LEAST_AXIS,
    MARKS,
    NO_LEVEL,
    said_of,
)
from phd_jdtc_ros.report.style import RADIUS_95


def head(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page's script has to know, see `page.picture`, by a tracker's parameters."""
    sensors = [name for name in values.get("sensors", ()) if not values.get(f"{name}.pose")]
    fixed = [name for name in sensors if f"{name}.position" in values]
    classes = values.get("classes") or ["class_0"]
    heights = any(values.get(f"{name}.fields.height") for name in values.get("sensors", ()))
    return {
        "first": 0,
        "levels": "m" if heights or values.get("state") == "space" else "",
        "ground": None,
        "no_level": NO_LEVEL,
        "axis": [AXIS_STEPS, LEAST_AXIS * RADIUS_95],
        "classes": [{"title": n, "colour": class_colour(k)} for k, n in enumerate(classes)],
        "sources": [FILTERED],
        "hold": {FILTERED: 1},
        "radars": list(values.get("sensors", ())),
        "sites": [[name, *values[f"{name}.position"][:2]] for name in fixed],
        "known": {"truth": False, "plots": True, "alarms": True},
        "rings": [],
        "zones": [],
        "amplitudes": [],
        "identities": [],
        "told": [],
        "marks": MARKS,
        "place_unknown": False,
        "columns": [],
    }


def _rounded(values: Any, step: float = 1.0) -> list[int]:
    rounded: list[int] = np.rint(np.asarray(values) / step).astype(np.int64).tolist()
    return rounded


def of_tracks(found: Estimates) -> dict[str, Any]:
    """Return the estimates as columns, in the units of the page's columns; places in metres."""
    found = found.select(found.track_id > 0)
    up, rows = found.known_attributes.height, np.arange(len(found))
    known = np.isfinite(up[:, 0])
    variance, axes = np.linalg.eigh(found.position_covariance)
    semi = np.log2(np.sqrt(np.maximum(variance, LEAST_AXIS**2)) / LEAST_AXIS)
    share = found.class_probability[rows, found.class_id]
    told: list[str] = []
    said: dict[str, Any] = {name: _rounded(v) for name, v in said_of([found], told).items()}
    if said:
        said["source"] = [told[k] for k in said["source"]]
    return {
        "time_s": found.stamp_ns * 1e-9,
        "number": found.track_id.tolist(),
        "x": np.round(found.position[:, 0], 1).tolist(),
        "y": np.round(found.position[:, 1], 1).tolist(),
        "vx": _rounded(found.velocity[:, 0], 0.1),
        "vy": _rounded(found.velocity[:, 1], 0.1),
        "course": _rounded(np.degrees(np.arctan2(*found.velocity.T)) % 360.0),
        "level": _rounded(np.where(known, up[:, 0], NO_LEVEL)),
        "climb": _rounded(np.nan_to_num(up[:, 1]), 0.1),
        "class": found.class_id.tolist(),
        "share": _rounded(share, 0.01),
        "weight": _rounded(found.weight, 0.01),
        "state": found.track_state.tolist(),
        "minor": _rounded(semi[:, 0], 1.0 / AXIS_STEPS),
        "major": _rounded(semi[:, 1], 1.0 / AXIS_STEPS),
        "angle": _rounded(np.degrees(np.arctan2(axes[:, 1, 1], axes[:, 0, 1])) % 180.0),
        "who": vertical.identities(found),
        **said,
    }


def of_plots(x: Any, y: Any, radar: Any) -> dict[str, Any]:
    """Return detections as columns; places in metres."""
    return {"x": _rounded(x), "y": _rounded(y), "radar": radar.tolist()}


def of_alarms(found: Conflicts) -> dict[str, Any]:
    """Return the alarms of conflicts as columns."""
    rows = np.flatnonzero(found.alarm)
    columns = ("kind", "first", "second", "alarm")
    return {
        **{name: getattr(found, name)[rows].tolist() for name in columns},
        "chance": _rounded(found.probability[rows], 0.01),
        "x": _rounded(found.place[rows, 0]),
        "y": _rounded(found.place[rows, 1]),
    }


def event(kind: str, content: Mapping[str, Any] | Sequence[Any]) -> bytes:
    """Return a server-sent event."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return f"event: {kind}\ndata: {text}\n\n".encode()
