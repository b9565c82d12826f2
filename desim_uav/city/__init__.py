"""Cities: extracts of maps, read and cut into convex prisms, and synthetic ones."""
