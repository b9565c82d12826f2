"""What is measured of a run: which measures there are, and how tables give their values."""
