"""The filter and the smoother over scans.

`forward_filter` predicts, updates and reduces the targets that a scan has swept (`swept`); `update`
is the update with the reports of a scan; `fixed_lag` is the engine, which smooths over the lag
window, and numbers and reports tracks; `window_snapshot` stores its mixtures.
"""
