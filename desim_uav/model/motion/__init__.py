"""How drones fly: from cell to cell, or freely in straight legs; wind, speeds and ways home."""
