"""Studies of single questions, each on one runner: ``python -m studies NAME``.

They are not part of the installed package, whose `monte_carlo` is the reference study::

    command     NAME -> a study; `all` and `rest` are what ``make study`` runs, and
                `monte_carlo` is the reference study with the peers
      |
    runner      seeds, goals, tables, out/study/NAME.json, the goals of summary.json
      |
    madap           the figures of a published benchmark of multi-radar trackers
    registration    known errors of radars, found in plots
    handover        two trackers that divide an area, against one
    hours           simulated recordings of an hour, tracked without a configuration
    autoferry       recordings of a public dataset, with this package and other trackers
    misspecified    trackers whose radars are misconfigured
    changed_radars  how soon it is noticed that a radar has changed
    calibration     probabilities and covariances beside what is true, on drawn truth
    hard_traffic    aircraft in hard turns, and before a radar of coarse azimuths
    new_scenes      twelve scenes that nothing was tuned on, beside a JIPDA tracker
    league          trackers side by side on recordings that a manifest names
    tuning_truth    proposals of `tune` beside the simulated values
    space           targets with heights, beside trackers in the plane
    positions       people and vehicles from the places that a lidar reports

`peers` has other trackers for comparison. A study computes the figures of a seed, and derives goals
and tables from figures.
"""
