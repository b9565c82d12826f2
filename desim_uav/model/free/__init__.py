"""Free flight: straight legs of any direction, wind, obstacles, ways round them, separation."""
