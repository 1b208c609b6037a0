"""Draws what accuracy costs: `python docs/images/what_accuracy_costs.py [FILE]`.

The numbers are those that `benchmarks/work_precision.py` and `benchmarks/accuracy.py` recorded.
"""

import re
import sys
from pathlib import Path

from matplotlib.figure import Figure

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
# The chapter's section 39.4.2: what its reduced models save, at no error that it would print. They
# stand at that of the full model at this tolerance.
SAVED, RTOL = {"POD": 0.12, "SOD": 0.30}, 1e-6

Runs = list[tuple[float, float, float]]  # rtol, error, time [ms]


def full() -> Runs:
    """The runs of the full model."""
    text = (BENCHMARKS / "work_precision.txt").read_text()
    text = text.split("cart-pendulum: all runs:")[1].split("all runs:")[0]
    rows = [line.split() for line in text.splitlines() if line.startswith("Rodas5P")]
    return [(float(row[1]), float(row[2]), float(row[3])) for row in rows]


def reduced() -> Runs:
    """Those of the model in three minimal coordinates."""
    text = (BENCHMARKS / "accuracy.txt").read_text()
    rows = re.findall(r"POD minimal, r = 3 +\w+ +(\S+e-\d+) +(\S+e-\d+) +(\S+)", text)
    return sorted({tuple(map(float, row)) for row in rows}, reverse=True)


if __name__ == "__main__":
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot(xlabel="error", ylabel="time of a run [ms]")
    for label, runs, look in (
        ("full model, 8 coordinates", full(), "k.-"),
        ("reduced model, 3 minimal coordinates by POD", reduced(), "C0o-"),
    ):
        _, errors, times = zip(*runs, strict=True)
        axes.loglog(errors, times, look, label=label)
    ((error, time),) = [(error, time) for rtol, error, time in full() if rtol == RTOL]
    for name, saved in SAVED.items():
        point = error, (1 - saved) * time
        axes.plot(*point, "C3D", label="reduced models as the chapter has them" * (name == "POD"))
        words = f"{name}, −{saved:.0%}"
        # On the side where no curve passes.
        side, align = (8, "left") if name == "POD" else (-8, "right")
        axes.annotate(words, point, (side, -4), textcoords="offset points", ha=align)
    axes.invert_xaxis()
    axes.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
    axes.minorticks_off()
    axes.grid(color="0.9")
    axes.legend()
    figure.savefig(sys.argv[1] if sys.argv[1:] else Path(__file__).with_suffix(".png"), dpi=110)
