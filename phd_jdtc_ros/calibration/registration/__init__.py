"""Registration: the systematic errors of radars, by targets that several of them see.

    plots of each radar -> sensors (tracks of each) -> common (targets that several see)
      -> sequences -> filtering (targets and errors together) -> observability -> solution

`sensors` links each radar's plots to tracks. `common` finds which tracks of different radars are of
one target, and `sequences` puts the plots of every target in one order of time. `filtering` smooths
the targets and says, in the same pass, how all errors together would change what was measured; the
errors are the least squares solution. `observability` says which of them a recording tells at all.
`monitor` watches a running tracker for errors that come later.

References
----------
Rosenberg, "Random coefficients models: the analysis of a cross section of time series by
stochastically convergent parameter regression", Annals of Economic and Social Measurement 2(4),
1973; de Jong, "The diffuse Kalman filter", Annals of Statistics 19(2), 1991: constants estimated
beside the state, by one filter. Fischer, Muehe and Cameron, "Registration errors in a netted air
surveillance system", MIT Lincoln Laboratory, 1980.
"""
