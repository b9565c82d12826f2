"""A sweep: policies or trainings in every combination of the values of some keys, on common seeds.

A sweep goes through these files in one direction: ``grid`` (values and their combinations),
``plan`` (what is run in each), ``job`` (one of them on one seed), ``folder`` (its row), ``table``
(means over seeds) and ``run`` (all of it). ``results`` and ``pictures`` read a finished sweep.
"""
