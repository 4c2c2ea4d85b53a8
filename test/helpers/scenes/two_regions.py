"""The regions of two trackers that part an area, and the parameters of their hand-over."""

MARGIN = 4e3
REGIONS = {"west": [-60e3, -60e3, 0.0, 60e3], "east": [0.0, -60e3, 60e3, 60e3]}


def given(**more):
    """Return the parameters of the hand-over of both regions."""
    regions = {f"{name}.region": [*region, MARGIN] for name, region in REGIONS.items()}
    return {"trackers": list(REGIONS), **regions, **more}
