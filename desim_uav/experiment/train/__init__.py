"""A training: ``course`` learns in memory, ``folder`` keeps checkpoints and what was learned."""
