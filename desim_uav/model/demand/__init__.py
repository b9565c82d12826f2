"""When users make requests, and for which service."""
