"""The nine cases in nine rows: python analysis/short_paper_table.py analysis/paper/table.csv.

Of the table that ``desim-uav reproduce`` writes: QoE1 / QoE2 / QoE3 of each policy, and as printed.
"""

import sys

import pandas as pd

POLICIES = {"baseline": "baseline", "q_learning": "Q-learning", "sarsa": "SARSA"}
MEASURES = ("qoe1_percent", "qoe2_iterations", "qoe3_percent")


def triple(row: pd.Series, prefix: str, form: str) -> str:
    """QoE1 / QoE2 / QoE3."""
    return " / ".join(form.format(row[f"{prefix}{name}"]) for name in MEASURES)


def markdown(file: str, preset: str = "default", printed: bool = True) -> str:
    """The table in Markdown, with what the paper printed beside it if ``printed``."""
    table = pd.read_csv(file)
    table = table[table["preset"] == preset]
    headings = ["case", *POLICIES.values()]
    if printed:
        headings += [f"printed: {name}" for name in POLICIES.values()]
    lines = ["| " + " | ".join(headings) + " |", "|" + " --- |" * len(headings)]
    for case, rows in table.set_index("policy").groupby("case"):
        cells = [str(case), *(triple(rows.loc[policy], "", "{:.1f}") for policy in POLICIES)]
        if printed:
            cells += [triple(rows.loc[policy], "published_", "{:g}") for policy in POLICIES]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(file: str, preset: str = "default") -> None:
    """Print it."""
    print(markdown(file, preset))


if __name__ == "__main__":
    main(*sys.argv[1:])
