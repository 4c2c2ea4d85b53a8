"""Tracks as events of Cursor on Target (CoT) 2.0 in XML, as TAK servers and ATAK read them."""

from __future__ import annotations

import html
import math
import re
import uuid
from collections.abc import Sequence

import numpy as np

from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.core.types import TRACK_STATES, Estimates

from ..encoding import stamps
from ..targets import geodetic, vertical
from ..targets.tracks import rows_by_track

# Types of an atom with its affiliation and dimension, as far as they go.
TYPE = re.compile(r"a-[a-z]-[A-Z](-[A-Za-z0-9]+)*")


def type_of(classes: Sequence[str], class_id: int, identified: bool) -> str:
    """Return the type of a target, given the types of classes; empty for those of all.

    A target that reports its code or address is in the air, unless its class has a type. It says
    who it is, so that it is neutral where its class is unknown.
    """
    usual = "a-u-A" if identified else "a-u-G"
    kind = classes[class_id] if classes else usual
    return re.sub("^a-u-", "a-n-", kind) if identified else kind


def events(
    found: Estimates,
    plane: Plane,
    class_names: Sequence[str],
    types: Sequence[str],
    run: uuid.UUID,
    stale_s: float,
    manual: Manual,
) -> list[bytes]:
    """Encode each labelled estimate as an event, by ascending track number.

    An event is stale `stale_s` after its stamp. ``ce`` is the standard deviation along the long
    axis of the position's ellipse, and ``le`` that of the height, metres. An identifier belongs to
    a track of a tracker's `run`. `manual` has the names and the friends.
    """
    # A height and its error if they are not known.
    unknown_height = 'hae="9999999.0" le="9999999.0"'
    places, up = geodetic.of(found, plane), vertical.of(found)
    identities, words = vertical.identities(found), vertical.words(found, plane.origin[2])
    axes = np.sqrt(np.maximum(np.linalg.eigvalsh(found.position_covariance)[:, -1], 0.0))
    stale = stamps.to_iso(found.stamp_ns + round(stale_s * 1e9))
    now, sent = stamps.to_iso(found.stamp_ns), []
    for track, row in rows_by_track(found):
        class_id, height = int(found.class_id[row]), unknown_height
        if up.known[row]:
            std = math.sqrt(up.covariance[row, 0, 0])
            height = f'hae="{places.height[row]:.1f}" le="{std:.1f}"'
        course = np.nan_to_num(places.course[row])
        share = found.class_probability[row, class_id]
        state = TRACK_STATES[int(found.track_state[row])]
        kind = type_of(types, class_id, any(identities[row]))
        if track in manual.friends:
            kind = re.sub("^a-[un]-", "a-f-", kind)
        name = manual.names.get(track) or f"{track} {words[row]}".rstrip()
        sent.append(
            f'<?xml version="1.0" encoding="UTF-8"?><event version="2.0" '
            f'uid="{uuid.uuid5(run, str(track))}" '
            f'type="{kind}" '
            # Fused from several sources by a machine.
            f'how="m-f" time="{now}" start="{now}" stale="{stale}">'
            f'<point lat="{places.latitude[row]:.7f}" lon="{places.longitude[row]:.7f}" '
            f'ce="{axes[row]:.1f}" {height}/>'
            f'<detail><contact callsign="{html.escape(name)}"/>'
            f'<track speed="{places.speed[row]:.2f}" course="{course:.1f}"/>'
            f"<remarks>{html.escape(class_names[class_id], quote=False)} {share:.0%}, "
            f"{state}</remarks>"
            "</detail></event>\n".encode()
        )
    return sent
