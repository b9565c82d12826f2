"""How well any policy could do: best cells, returns and long-run averages, each with a bound."""
