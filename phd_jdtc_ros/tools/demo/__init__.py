"""The demo in one command, and its processes."""
