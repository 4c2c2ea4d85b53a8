"""Whether probabilities and covariances mean what they say, on truth drawn from the model.

::

    drawn_truth     targets, classes, SNR and detections, all drawn from a tracker's own model
    scores          said probabilities with their outcomes, and squared errors, summed over scans
    diagram         reliability diagrams
    study           the tracker on these runs, with goals and tables
"""
