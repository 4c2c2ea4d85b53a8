"""False detections: their rate, range and amplitudes, and the places from which they return.

A map (`map`) has cells (`grid`), which are judged by their neighbourhood, and is drawn as a raster.
"""
