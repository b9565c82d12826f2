"""The map as cells, crossings of circles, polygons, prisms, ways round them, and distances."""
