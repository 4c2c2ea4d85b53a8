"""The parts of every message: types, serialised bytes, columns of clouds, stamps and identities."""
