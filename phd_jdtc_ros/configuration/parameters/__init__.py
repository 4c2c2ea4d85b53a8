"""The parameters that a user sets: names, defaults, units, bounds and notations.

Each is a field of a dataclass, from which its check, its help and its page follow.
"""
