"""Pictures of an episode, for environments and films."""
