"""The benchmark: frozen tasks, submissions that can be replayed, and the leaderboard."""
