"""The SimPy engine: the readable reference."""

from desim_uav.engine.des.simulation import Simulation

__all__ = ["Simulation"]
