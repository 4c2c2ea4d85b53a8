"""A street as a lidar's driver sees it: people and cars, some standing, one through the sensor.

Clouds have x, y and z ten times a second, and nothing else.
"""

import numpy as np

INTERVAL_S, SECONDS = 0.1, 40
TIMES = INTERVAL_S * np.arange(round(SECONDS / INTERVAL_S))
EXTENT = np.array([40.0, 25.0])  # Half the sides of what the lidar sees, metres
STD, DETECTED, FALSE = 0.06, 0.95, 2.0  # Noise, metres; p_D; false clusters a cloud
# Start and velocity of each target, metres and metres per second; the first passes the sensor.
WALKING = ((-14.0, -7.0, 0.7, 0.35), (12.0, 15.0, -0.9, -0.6), (-25.0, 12.0, 1.3, 0.1))
DRIVING = ((-38.0, -3.0, 1.9, 0.0), (38.0, 3.0, -1.8, 0.05), (-36.0, -20.0, 1.7, 0.2))
STANDING = ((8.0, -12.0), (15.0, -10.0), (-20.0, -15.0), (30.0, 20.0), (0.5, 6.0))


def truth(seed):
    """Return the positions of all targets at all times, (T, N, 2); gaits and speeds vary."""
    rng = np.random.default_rng([seed, 1])
    moving = np.array([*WALKING, *DRIVING])
    place = moving[:, :2] + moving[:, 2:] * TIMES[:, None, None]
    # Slow weaving, other than at the sensor.
    side = np.stack([-moving[:, 3], moving[:, 2]], axis=1)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    phase = rng.uniform(0.0, 2.0 * np.pi, len(moving))
    sway = 0.3 * (np.sin(0.5 * TIMES[:, None] + phase) - np.sin(phase))
    sway[:, 0] = 0.0
    standing = np.broadcast_to(STANDING, (len(TIMES), len(STANDING), 2))
    return np.concatenate([place + sway[:, :, None] * side, standing], axis=1)


def clouds(seed):
    """Return the cloud of each time, (M, 3)."""
    rng, found = np.random.default_rng([seed, 2]), []
    for place in truth(seed):
        inside = (np.abs(place) < EXTENT).all(axis=1)
        seen = place[inside & (rng.random(len(place)) < DETECTED)]
        seen = seen + STD * rng.standard_normal(seen.shape)
        false = rng.uniform(-EXTENT, EXTENT, (rng.poisson(FALSE), 2))
        flat = np.concatenate([seen, false])
        points = np.column_stack([flat, rng.uniform(0.3, 1.5, len(flat))])
        found.append(points[rng.permutation(len(points))])
    return found


def table(seed):
    """Return the clouds as a table."""
    rows = clouds(seed)
    time = np.repeat(TIMES, [len(each) for each in rows])
    return dict(zip(("time", "x", "y", "z"), (time, *np.concatenate(rows).T), strict=True))


def true_tracks(seed):
    """Return the truth as a table, of targets within what the lidar sees."""
    place = truth(seed)
    label = np.broadcast_to(1 + np.arange(place.shape[1]), place.shape[:2])
    inside = (np.abs(place) < EXTENT).all(axis=2)
    time = np.broadcast_to(TIMES[:, None], inside.shape)
    columns = (time, label, place[..., 0], place[..., 1])
    names = ("time", "label", "x", "y")
    return {name: each[inside] for name, each in zip(names, columns, strict=True)}
