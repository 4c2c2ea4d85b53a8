"""An approach radar without amplitudes, whose plots have codes, and a tracker for it."""

PERIOD_S = 4.0
PARAMETERS = {
    "sensors": ["tower"],
    "interval_s": PERIOD_S,
    "lag": 2,
    "classes": ["aircraft"],
    "motions": ["cv"],
    "births": [],
    "detection_births.rates": [0.1],
    "detection_births.std": [150.0],
    "spawn.rate": 0.0,
    "aircraft.motions": ["cv"],
    "aircraft.mode_transition": [1.0],
    "amplitude": "none",
    "tower.topic": "/tower/plots",
    "tower.fields.amplitude": "",
    "tower.fields.code": "squawk",
    "tower.detection_probability": 0.95,
    "tower.range_std": 30.0,
    "tower.azimuth_std_deg": 0.1,
    "tower.max_range": 60e3,
    "tower.clutter_rate": 2.0,
    "tower.clutter_max_range": 60e3,
    "tower.learn": [],
}
