"""Configurations that begin with the reference scenario's values, for parts of any names.

They are not a tracker's defaults. A part with a name of its own has what the reference scenario's
parts have in common.
"""

from phd_jdtc_ros.configuration import build
from phd_jdtc_ros.parameter_files import from_arguments

VALUES = from_arguments.profile(from_arguments.REFERENCE)
# The lists of names, each with a part whose values all parts have in common.
COMMON = {
    "sensors": ("radar_1", ("learn",)),
    "classes": ("class_0", ("motions", "mode_transition")),
    "motions": ("cv", ()),
    "births": ("start_1", ()),
}
NAMES = {"sensors": ["radar_1", "radar_2"], "classes": ["class_0", "class_1"], **VALUES}


def parameters(given=None):
    """Return the reference scenario's parameters, changed by `given`."""
    given = dict(given or {})
    names = {group: given.get(group, NAMES[group]) for group in COMMON}
    listed = {name for own in names.values() if isinstance(own, list) for name in own}
    known = {
        name: value
        for name, value in VALUES.items()
        if name.partition(".")[0] in listed
        or name.partition(".")[0] in ("detection_births", "spawn")
        or "." not in name
    }
    for group, (part, members) in COMMON.items():
        for name in names[group] if isinstance(names[group], list) else ():
            known |= {f"{name}.{own}": VALUES[f"{part}.{own}"] for own in members}
    return known | given


def resolve(given=None, *plane):
    """Return the configuration of `parameters`."""
    return build.resolve(parameters(given), *plane)
