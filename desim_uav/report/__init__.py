"""Reports, replays, figures, films and tables of results."""
