"""Columns of a cloud or of a table, as a radar reports them, to `Detections` and back.

`selection` keeps the valid rows and counts the others, in numpy alone: the messages of sensors and
the tables of the Python API pass it alike. `anomalies` says what contradicts the configuration.
`sent_columns` is the inverse of `selection`, for simulated radars.
"""
