"""A self-contained page that plays a run's episodes in continuous time."""
