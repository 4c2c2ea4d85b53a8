"""The Monte Carlo study: the tracker, a reference and other trackers on the same simulated runs.

::

    scenario, seed
      |  simulate                            tracker
    SimulatedRun: truth, scans, sources      tracker
      |  this package's tracker              tracker
      |  the model-matched reference         reference
      |  other trackers                      peers
    Tracks: estimates by lag and scan        tracker
      |  score and store each run            monte_carlo
      |  summarise over runs                 monte_carlo
    results.csv, summary.json
      |  draw, tabulate                      figures
    pictures, tables

`monte_carlo` reads a study's definition, plans its tasks and runs them. The repository's folder
`studies` has studies of single questions, which use these modules.
"""
