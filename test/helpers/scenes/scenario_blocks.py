"""Blocks of scenario documents, and parameters of radars whose detections are exact."""

TARGET = {
    "class_id": 1,
    "snr_db": 20.0,
    "position": [1.0, 2.0],
    "velocity": [3, -4],
    "first_scan": 5,
    "last_scan": 7,
}
TURN = {"first_scan": 5, "last_scan": 7, "turn_rate_deg_s": -3.0}
FLIGHT = {
    "class_id": 1,
    "position": [1.0, 2.0],
    "velocity": [30.0, 0.0],
    "start_s": 4.0,
    "legs": [{"duration_s": 20.0}, {"duration_s": 10.0, "turn_rate_deg_s": 3.0}],
}
RACE = {"straight_nm": 20.0, "turn_deg": 175.0, "flights": [[240.0, 60.0, 52.0, 7.0]]}
UNIFORM = {"law": "uniform", "lowest_db": 10.0, "highest_db": 20.0}
QUAY = {
    "points": [1000.0, 3000.0, 1000.0, 4000.0, 2000.0, 4000.0],
    "spacing": 100.0,
    "detection_probability": 1.0,
    "amplitude": {"law": "log_normal", "level_db": 18.0, "std_db": 3.0},
}
SHIP = {
    "position": [-500.0, 100.0],
    "velocity": [6.0, 8.0],
    "legs": [{"duration_s": 20.0}, {"duration_s": 60.0, "turn_rate_deg_s": 3.0}],
}


def turning(*turns):
    """Return a document with one target that lives from scan 5 to scan 20."""
    return {"targets": [{**TARGET, "last_scan": 20, "turns": list(turns)}]}


def exact(name, max_range, **changes):
    """Return the parameters of a lone radar almost without noise, misses and clutter."""
    own = {
        "range_std": 1e-3,
        "azimuth_std_deg": 1e-6,
        "detection_probability": 0.999,
        "clutter_rate": 0.0,
        "clutter_max_range": max_range,
        "max_range": max_range,
        "fields.time": "time",
        **changes,
    }
    return {"sensors": [name], **{f"{name}.{key}": value for key, value in own.items()}}
