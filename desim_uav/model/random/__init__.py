"""Random streams, numbers that are functions of counters, and distributions."""
