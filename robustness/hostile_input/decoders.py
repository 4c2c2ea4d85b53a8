"""Random input for the decoders and the bag reader: either decoded or refused with their errors."""

from __future__ import annotations

import contextlib
import os
import random
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from msg_adapters.encoding import RejectedMessageError, interfaces, names
from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.intake.revolutions import Revolutions
from phd_jdtc_ros.core.intake.scans import Rejection

from ..harness import scans
from ..harness.figures import Found, measures
from . import bags, raw_bytes
from .small_chunks import rewritten

EXAMPLES = 10_000
FIELDS = (
    *("x", "y", "z", "range", "azimuth", "elevation", "amplitude", "time", "sector", "height"),
    *("range_std", "azimuth_std", "elevation_std", "x_std", "y_std", "z_std", "correlation"),
    *("vx", "vy", "vz", "velocity_std", "area_x_min", "area_y_min", "area_x_max", "area_y_max"),
)
# A radar with all optional fields.
RADAR = resolve(
    {
        "radar_1.rotation_s": 4.0,
        "radar_1.sectors": 16,
        "radar_1.fields.time": "time",
        "radar_1.fields.sector": "sector",
        "radar_1.fields.height": "height",
        "radar_1.fields.range_std": "range_std",
        "radar_1.fields.azimuth_std": "azimuth_std",
    }
).radars[0]
_SPACE = {
    "state": "space",
    "sensors": ["radar_1", "lidar"],
    "radar_1.fields.elevation": "elevation",
    "radar_1.fields.elevation_std": "elevation_std",
    "radar_1.fields.height": "height",
    "lidar.kind": "position",
    "lidar.frame": "radar_1",
    "lidar.fields.velocity_std": "velocity_std",
    "radar_1.frame": "other",
}
# The same in space, and sensors of positions in the plane and in space.
IN_SPACE, LIDAR_IN_SPACE = resolve(_SPACE).inputs
LIDAR = resolve({"sensors": ["lidar"], "lidar.kind": "position", "lidar.frame": "radar_1"}).inputs[
    0
]
SENSORS = (RADAR, replace(IN_SPACE, frame=RADAR.frame), LIDAR, LIDAR_IN_SPACE)

_SIZES = st.one_of(st.integers(0, 40), st.sampled_from([2**16, 2**31, 2**32 - 1]))
_FIELD = st.builds(
    PointField,
    name=st.sampled_from(FIELDS),
    offset=st.one_of(st.integers(0, 24), _SIZES),
    datatype=st.one_of(st.sampled_from([7, 8]), st.integers(0, 255)),
    count=st.one_of(st.just(1), _SIZES),
)


@st.composite
def clouds(draw: st.DrawFn) -> PointCloud2:
    """Draw clouds, of which about half are consistent."""
    consistent = draw(st.booleans())
    width, height = draw(st.integers(0, 12)), draw(st.integers(1, 2))
    step = draw(st.integers(8, 32))
    row = width * step + draw(st.sampled_from([0, 0, 4]))
    data = draw(st.binary(min_size=row * height, max_size=row * height))
    fields = draw(st.lists(_FIELD, max_size=12, unique_by=lambda field: field.name))
    if consistent:
        fields += [
            PointField(name=name, offset=4 * place, datatype=PointField.FLOAT32, count=1)
            for place, name in enumerate(draw(st.sampled_from([("range", "azimuth"), ("x", "y")])))
            if name not in {field.name for field in fields}
        ]
    else:
        width, height, step, row = (
            draw(st.one_of(st.just(n), _SIZES)) for n in (width, height, step, row)
        )
        data = draw(st.one_of(st.just(data), st.binary(max_size=200)))
    frame = draw(st.sampled_from([RADAR.frame, RADAR.frame, RADAR.frame, "map", ""]))
    return PointCloud2(
        header=Header(frame_id=frame),
        width=width,
        height=height,
        fields=fields,
        is_bigendian=draw(st.booleans()),
        point_step=step,
        row_step=row,
        data=data,
    )


@measures("exits or NaN on bad scans", "10,000 hypothesis examples: 0 other errors, 0 NaN")
def measure(examples: int = EXAMPLES) -> Found:
    """Decode random clouds and mutated serialised ones."""
    outcomes: Counter[str] = Counter()

    @seed(1)
    @settings(
        max_examples=examples // 2,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(clouds(), st.sampled_from(SENSORS))
    def built(cloud: PointCloud2, sensor: SensorParameters) -> None:
        outcomes[_outcome(cloud, sensor)] += 1

    built()
    rng = random.Random(2)
    with _quiet():
        for index in range(examples - examples // 2):
            outcomes[_decode(raw_bytes.mutate(scans.cloud(index, 0), rng))] += 1
    wrong = sum(count for what, count in outcomes.items() if what.startswith(("error", "NaN")))
    rejected = sum(count for what, count in outcomes.items() if what.startswith("rejected"))
    text = (
        f"{outcomes.total():,} examples: {wrong} other errors or NaN, {rejected:,} rejected, "
        f"{outcomes['decoded']:,} decoded"
    )
    return text, not wrong and outcomes["decoded"] > 0, dict(outcomes)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the output of Fast CDR about unreadable messages."""
    kept = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _decode(data: bytes) -> str:
    try:
        cloud = interfaces.decode(data, names.CLOUD)
    except RejectedMessageError as error:
        return f"rejected: {error.reason}"
    except Exception as error:
        return f"error: {type(error).__name__}: {error}"[:120]
    return _outcome(cloud)


def _outcome(cloud: PointCloud2, sensor: SensorParameters = RADAR) -> str:
    try:
        report = reader_of(sensor).from_msg(cloud, sensor)
        found = report.detections
        polar = Revolutions(sensor.rotation_s or 4.0, sensor.sectors)
        parts = polar.split(report.stamp_ns, found, report.sector) if sensor.may_turn else ()
    except RejectedMessageError as error:
        return f"rejected: {error.reason}"
    except Exception as error:  # Any other exception would end a node
        return f"error: {type(error).__name__}: {error}"[:120]
    lost = isinstance(parts, Rejection) or sum(len(part) for _, part in parts) != len(found)
    if lost and sensor.may_turn:
        return "error: detections lost"
    # Only amplitudes, heights, velocities and standard deviations may be NaN, where unknown.
    values = [found.measurement, *([] if found.time_s is None else [found.time_s])]
    optional = (
        *(found.amplitude, found.noise_std, found.z, found.z_std),
        *(found.velocity, found.velocity_std, None if found.area is None else np.array(found.area)),
    )
    unknown = [each for each in optional if each is not None]
    finite = all(np.isfinite(value).all() for value in values)
    return "decoded" if finite and not any(np.isinf(each).any() for each in unknown) else "NaN"


@measures("bag reader on random damage", "0 errors but BagError, 0 false messages")
def measure_bags(examples: int = EXAMPLES // 10) -> Found:
    """Read bags damaged in several places at once."""
    rng = random.Random(3)
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as directory:
        original = rewritten(scans.BAG, Path(directory) / "whole.mcap", CompressionType.ZSTD)
        every = set(BagReader(original).messages())
        whole, file = original.read_bytes(), Path(directory) / "damaged.mcap"
        for _ in range(examples):
            file.write_bytes(_damage(whole, rng))
            outcomes[_read(file, every)] += 1
    wrong = sum(n for what, n in outcomes.items() if what not in ("whole", "part", "refused"))
    text = f"{examples:,} damaged bags: {wrong} other errors or false messages"
    return text, not wrong, dict(outcomes)


def _read(file: Path, every: set[Any]) -> str:
    try:
        found, error = bags.outcome(file)
    except Exception as other:
        return f"error: {type(other).__name__}: {other}"[:120]
    if not set(found) <= every:
        return "false messages"
    if error is None:
        return "whole" if set(found) == every else "silently less"
    return "part" if found else "refused"


def _damage(data: bytes, rng: random.Random) -> bytes:
    for _ in range(rng.randrange(1, 6)):
        at, size = rng.randrange(len(data)), rng.randrange(1, 60)
        kind = rng.randrange(4)
        if kind == 0:
            data = data[:at] + rng.randbytes(size) + data[at + size :]
        elif kind == 1:
            data = data[:at] + data[at + size :]
        elif kind == 2:
            data = data[:at] + rng.randbytes(size) + data[at:]
        elif rng.random() < 0.3:
            data = data[: max(at, 1)]
    return data
