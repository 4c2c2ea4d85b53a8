"""Places on the earth as a radar sees them, by PROJ."""

from pyproj import Transformer


def seen_from(latitude, longitude, height):
    """Return a conversion of longitude, latitude and height to metres east, north and up."""
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        "+step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lat_0={latitude} +lon_0={longitude} +h_0={height}"
    )
