"""Parameters of earlier versions, and what has taken their place.

Each is refused with these words. ``docs/upgrade.md`` is written from these tables.
"""

from __future__ import annotations

from collections.abc import Mapping

# What is no longer asked for, in words.
CONSTANT = "it is a constant now"
DERIVED = "it follows from the others"
REMAPPED = "remap the topic, as with -r BEFORE:=NOW"
ACCURACY = "use accuracy: fast, normal or high"
ENGINE = "use engine: particles, phd or phd_as_printed"
OUTPUTS = "use outputs, a list with {} in it"

TRACKER: Mapping[str, str] = {
    "radars": "use sensors",
    "existence_threshold": "use confirm_probability and delete_probability",
    "fixed_interval": "a matrix without a rate matrix holds for whole intervals",
    "reorder_scans": "use reorder_s, or late_reports: rework",
    "region_margin": "use region, the margin as its fifth number",
    "lag_s": "use lag, as in '20 s'",
    "corrector": ENGINE,
    "death_term": ENGINE,
    "extraction": ENGINE,
    "hypotheses_per_target": ACCURACY,
    "least_hypothesis": ACCURACY,
    "merge_distance": ACCURACY,
    "least_mode": ACCURACY,
    "max_hypotheses": ACCURACY,
    "least_particles": DERIVED,
    "max_particles": CONSTANT,
    "amplitude_jitter": CONSTANT,
    "reply_probability": CONSTANT,
    "code_garbled": CONSTANT,
    "shared_code_probability": CONSTANT,
    "code_kept_s": CONSTANT,
    "clutter_reply_probability": CONSTANT,
    "height_noise_density": CONSTANT,
    "height_climb_std": CONSTANT,
    "height_garbled": CONSTANT,
    "height_evidence": CONSTANT,
    "spawn.position_std": CONSTANT,
    "spawn.velocity_std": CONSTANT,
    "spawn.turn_rate_std": CONSTANT,
    "spawn.particles_per_target": CONSTANT,
    "spawn.class_transition": DERIVED,
    "spawn.mode_transition": DERIVED,
}
# Of each name in `sensors`.
RADAR: Mapping[str, str] = {
    "pose_message": "use pose, with pose_stamped after the topic",
    "pose_yaw": "use pose, with stabilised after the topic",
    "pose_max_speed": CONSTANT,
    "range_step": "use range_std, with the root of a twelfth of the squared step in it",
    "azimuth_step_deg": "use azimuth_std_deg, with the root of a twelfth of the squared step in it",
    "detection_probability_over_range": "use detection_probability, which may be such a list",
    "clutter_level_db": "use clutter_amplitude, with the level after the law",
    "clutter_std_db": CONSTANT,
    "range_rate_span": CONSTANT,
    "height": "use position, the height as its third number",
}
NODE: Mapping[str, str] = {
    **{
        f"publish_{name}": OUTPUTS.format("paths" if name == "path" else name)
        for name in (
            *("detections", "frames", "markers", "plots", "path", "odometry", "radar_tracks"),
            *("detections_3d", "navsat", "geojson"),
        )
    },
    "registration_monitor": OUTPUTS.format("registration"),
    "checkpoint.max_age_s": CONSTANT,
    "path_length": CONSTANT,
    "silent_after_scans": CONSTANT,
    "step_time_limit": CONSTANT,
}
EVALUATOR: Mapping[str, str] = {
    "truth_topic": REMAPPED,
    "class_names": "use classes, a list of their names",
    "publish_plots": "they are always published",
    "radar_topics": "use record_topics",
    "pose_topics": "use record_topics, with odometry or pose_stamped after the topic",
    "pose_message": "use record_topics, with odometry or pose_stamped after the topic",
}
REPLAY: Mapping[str, str] = {
    "progress": "there is a line if there is a terminal",
}
BRIDGE: Mapping[str, str] = {
    "estimates_topic": REMAPPED,
    "max_prediction_s": CONSTANT,
    "output_sac": "use output_source: [SAC, SIC, service]",
    "output_sic": "use output_source: [SAC, SIC, service]",
    "output_service": "use output_source: [SAC, SIC, service]",
}
BRIDGE_RADAR: Mapping[str, str] = {
    "sac": "use source: [SAC, SIC]",
    "sic": "use source: [SAC, SIC]",
}
HAND_OVER: Mapping[str, str] = {
    "smoothed_wait_s": CONSTANT,
    "world_frame": "it is that of the first estimates",
}
HAND_OVER_TRACKER: Mapping[str, str] = {"region_margin": "region, the margin as its fifth number"}
