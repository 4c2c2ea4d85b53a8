"""Studies of single questions, each on one runner: ``python -m studies NAME``.

Not part of the installed package, whose `monte_carlo` is the study of reference::

    command     NAME -> a study; `all` and `rest` are what ``make study`` runs
      |
    runner      seeds, goals, tables, out/study/NAME.json, the goals of summary.json
      |
    madap           the figures of a published benchmark of multi-radar trackers
    registration    known errors of radars, found in plots
    handover        two trackers that divide an area, against one
    hours           simulated recordings of an hour, tracked with nothing set
    autoferry       recordings of a public dataset, and other trackers on them
    tuning_truth    what `tune` proposes, beside what was simulated

A study gives the figures of a seed, and makes goals and tables of figures.
"""
