"""The compiled engine: event for event the SimPy engine's, without its objects."""

from desim_uav.engine.batch.simulation import BatchSimulation

__all__ = ["BatchSimulation"]
