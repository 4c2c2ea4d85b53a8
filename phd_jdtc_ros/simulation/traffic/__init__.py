"""Random traffic for scenarios: flights, ships and cars by their kinds."""
