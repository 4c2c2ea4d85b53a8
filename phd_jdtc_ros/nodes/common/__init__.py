"""Shared code of the nodes: start and stop, parameters, topics, health."""
