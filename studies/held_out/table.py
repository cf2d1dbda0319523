"""Print the table of docs/pretrained.md from generalist.csv, a table of the run's report.

Run as `python studies/held_out/table.py`. p-values are exact for so few rigs without ties, times
the number of tests of the run (Bonferroni).
"""

from pathlib import Path

import pandas as pd

from tracking.statistics.rank_tests import lower_tail_of_rho

ROWS = {
    "recall of all": ("all", "recall"),
    "Car recall": ("Car", "class_recall_3D"),
    "Car AP @ 0.7": ("Car", "AP_R40_3D"),
    "Pedestrian recall": ("Pedestrian", "class_recall_3D"),
    "Pedestrian AP @ 0.5": ("Pedestrian", "AP_R40_3D"),
    "Cyclist AP @ 0.5": ("Cyclist", "AP_R40_3D"),
}
"""Class and metric."""


def main() -> None:
    """Print a row for each of ROWS."""
    table = pd.read_csv(Path(__file__).parent / "generalist.csv").set_index(["class", "metric"])
    print("| | ρ (95 % over rigs) | p | regret | bias |\n|---|---|---|---|---|")
    for name, key in ROWS.items():
        row = table.loc[key]
        rho = f"{row['spearman']:.2f} ({row['spearman_low']:.2f} to {row['spearman_high']:.2f})"
        regret = row["regret (points)"]
        lost = "" if pd.isna(regret) else f"{regret:.1f}"
        cells = (rho, f"{corrected_p(row):.1g}", lost, f"{row['bias (points)']:+.1f}")
        print("| " + " | ".join((name, *cells)).replace("-", "−") + " |")


def corrected_p(row: pd.Series) -> float:
    """Two-sided p-value of rho for all tests of the run."""
    n = int(row["n"])
    lower = n * (n + 1) ** 2 / 4 - abs(row["spearman"]) * (n**3 - n) / 12
    return min(2 * lower_tail_of_rho(n)[round(lower)] * row["spearman_tests"], 1.0)


if __name__ == "__main__":
    main()
