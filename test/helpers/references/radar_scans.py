"""Serialised ``radar_msgs/RadarScan`` by an independent encoder, for what reads recorded bytes."""

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from msg_adapters.encoding.stamps import NS_PER_S

TYPE = "radar_msgs/msg/RadarScan"
RETURN = """float32 range
float32 azimuth
float32 elevation
float32 doppler_velocity
float32 amplitude
"""
SCAN = "std_msgs/Header header\nradar_msgs/RadarReturn[] returns\n"
SEPARATOR = "=" * 80 + "\n"
HEADER = "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
TIME = "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
# MCAP stores the definition followed by those of all types that it holds.
DEFINITION = SCAN + "".join(
    f"{SEPARATOR}MSG: {text}" for text in (f"radar_msgs/RadarReturn\n{RETURN}", HEADER, TIME)
)

_STORE = get_typestore(Stores.ROS2_JAZZY)
_STORE.register(get_types_from_msg(RETURN, "radar_msgs/msg/RadarReturn"))
_STORE.register(get_types_from_msg(SCAN, TYPE))


def cdr(stamp_ns, frame, rows, little_endian=True):
    """Return a scan of (range, azimuth, elevation, amplitude) rows."""
    of = _STORE.types
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    stamp = of["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    header = of["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)
    returns = [
        of["radar_msgs/msg/RadarReturn"](
            range=np.float32(distance),
            azimuth=np.float32(azimuth),
            elevation=np.float32(elevation),
            doppler_velocity=np.float32(7.0),
            amplitude=np.float32(amplitude),
        )
        for distance, azimuth, elevation, amplitude in rows
    ]
    message = of[TYPE](header=header, returns=returns)
    return bytes(_STORE.serialize_cdr(message, TYPE, little_endian=little_endian))


def decoded(data):
    """Return the message that CDR bytes contain."""
    return _STORE.deserialize_cdr(data, TYPE)


def type_hash():
    """Return the RIHS01 hash of the type."""
    return _STORE.hash_rihs01(TYPE)
