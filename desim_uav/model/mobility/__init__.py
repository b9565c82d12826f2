"""How users move: models that draw their walks, and recorded ones."""
