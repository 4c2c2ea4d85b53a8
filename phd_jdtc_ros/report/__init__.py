"""The report of one recorded run: its scores, an HTML page and pictures.

::

    bag with estimates
      |  decode                              load
    Record                                   record
      |  score                               table (terminal, JSON)
      |  draw                                page (HTML, Plotly), figures (PNG, Matplotlib): maps,
      |                                        curves; residuals of a registration
      |  write the tracks                    track_files (CSV, GeoJSON)
"""
