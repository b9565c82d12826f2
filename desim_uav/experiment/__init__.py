"""What is done with a scenario: runs, and what stands on runs."""
