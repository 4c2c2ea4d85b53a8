"""Shared code of the nodes: start and stop, parameters, QoS overrides."""
