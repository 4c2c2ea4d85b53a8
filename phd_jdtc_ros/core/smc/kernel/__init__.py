"""The transition density from particles to later particles, and the backward kernel made of it."""
