"""How well any policy could do: best places, best returns, best long runs, each with its proof."""
