"""Work with a scenario: runs, trainings, comparisons, sweeps and their folders."""
