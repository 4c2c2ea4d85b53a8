"""Registration: estimates the biases of radars from targets that several of them detect.

    plots of each radar -> tracks -> common targets -> filter (targets and biases) -> solution

`common` links each radar's plots to tracks, finds the tracks of different radars that belong to one
target, and sorts the plots of every target by time. Its filter smooths the targets, and computes in
the same pass the sensitivity of the innovations to all biases; the biases are the least squares
`solution`, which also determines which biases a recording can show. `monitor` checks a running
tracker for biases that appear later.

References
----------
Rosenberg, "Random coefficients models: the analysis of a cross section of time series by
stochastically convergent parameter regression", Annals of Economic and Social Measurement 2(4),
1973; de Jong, "The diffuse Kalman filter", Annals of Statistics 19(2), 1991: constants estimated
beside the state, by one filter. Fischer, Muehe and Cameron, "Registration errors in a netted air
surveillance system", MIT Lincoln Laboratory, 1980.
"""
