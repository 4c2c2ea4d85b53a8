"""Scenarios with known truth, and radars' simulated reports of them.

::

    document (YAML, read elsewhere)
      |  check                               scenario_file, checked
      |  many targets by one block           traffic
    Scenario: targets, turns, radars         scenario, targets
      |  detect, with clutter                simulate, clutter
    (Truth, Scan) by stamp
      |  for turning radars                  turning_antenna
    SimulatedReport by revolution or sector, with times
"""
