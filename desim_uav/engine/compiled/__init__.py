"""The compiled engine."""

from desim_uav.engine.compiled.simulation import BatchSimulation

__all__ = ["BatchSimulation"]
