"""What will change in the air, worked out once for both engines.

Kernels here are given the addresses of rows (``sky.rows``), which both engines have in memory. They
know neither the rules nor an engine.
"""
