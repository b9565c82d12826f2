"""The SimPy engine, which is the reference for the compiled engine."""

from desim_uav.engine.des.simulation import Simulation

__all__ = ["Simulation"]
