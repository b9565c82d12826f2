"""Files of maps in longitudes and latitudes, and their places in metres."""
