"""The power that flight takes, as a function of speed, and its integrals in closed form."""
