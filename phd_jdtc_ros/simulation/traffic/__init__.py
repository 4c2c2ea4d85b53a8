"""Targets of scenarios: flights, random traffic and gaps in sight."""
