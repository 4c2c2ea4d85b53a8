"""The transition density between two particle sets, and the backward kernel built from it."""
