"""Foxglove's message paths."""

import re


def values(message, path):
    """Return what a Foxglove message path without its topic leads to in a message."""
    found = [message]
    for name, field, wanted in re.findall(r'\.(\w+)|\[:\]|\{(\w+)=="([^"]*)"\}', path):
        if name:
            found = [getattr(entry, name) for entry in found]
        elif field:
            found = [entry for entry in found if getattr(entry, field) == wanted]
        else:
            found = [inner for entry in found for inner in entry]
    return found
