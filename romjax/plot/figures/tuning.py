"""The search for Baumgarte's parameters."""

import numpy as np
from matplotlib.figure import Figure

from ...common.checks import check_kind
from ...study.fits.tune import Tuning
from ..style import COLOURS, SMALL, DisplayedFigure


def tuning(result: Tuning, *, count: int = 25) -> Figure:
    """The loss over α and β with the path of the search on it, and the loss and drift by step.

    The dashed line is critical damping β = α²/4, with the default `Baumgarte.critical(ω)` of the
    mechanism's own frequency on it. The grid of `count` by `count` losses is simulated for the
    figure, as one batch for each row. Of parameters per constraint, their means are drawn and the
    landscape is left out.
    """
    check_kind("tuning", "the result", result, Tuning, "what romjax.tune_baumgarte returns")
    figure = DisplayedFigure(figsize=(9.5, 4))
    figure.set_layout_engine("constrained")
    plane, progress = figure.subplots(1, 2)
    alpha, beta = (x.reshape(len(x), -1).mean(axis=1) for x in (result.alpha, result.beta))
    if result.alpha.ndim == 1:
        alphas, betas, losses = result.landscape(count)
        low = np.nanmin(losses)
        # Whatever fails or is far worse than the start has one colour.
        high = max(low + 1, min(np.nanmax(losses), result.loss[0] + 5))
        filled = np.clip(np.where(np.isnan(losses), high, losses), low, high)
        shades = plane.contourf(alphas, betas, filled, levels=24, cmap="viridis_r")
        figure.colorbar(shades, ax=plane, label="loss")
        bottom, top = betas[[0, -1]]
        across = alphas
    else:
        bottom, top = 0.3 * beta.min(), 3 * beta.max()
        across = np.array([0.3 * alpha.min(), 3 * alpha.max()])
    plane.plot(across, across**2 / 4, "--", color="white", linewidth=3)
    plane.plot(across, across**2 / 4, "--", color="black", linewidth=1, label="critical damping")
    style = {"markeredgecolor": "white", "linestyle": "none"}
    plane.plot(alpha, beta, "-", color=COLOURS[1], linewidth=2, label="search")
    plane.plot(alpha[0], beta[0], "s", color=COLOURS[1], label="start", **style)
    best = [float(np.mean(x)) for x in (result.best.alpha, result.best.beta)]
    plane.plot(*best, "*", color=COLOURS[1], markersize=15, label="best", **style)
    omega = result.frequency
    plane.plot(2 * omega, omega**2, "o", color="black", label="default", **style)
    plane.set(xscale="log", yscale="log", ylim=(bottom, top), xlim=(across[0], across[-1]))
    plane.set_xlabel(r"$\alpha$ [1/s]")
    plane.set_ylabel(r"$\beta$ [1/s$^2$]")
    plane.set_title("Baumgarte's parameters", fontsize=11)
    plane.legend(fontsize=SMALL)

    step = np.arange(len(result.loss))
    progress.plot(step, result.loss, color=COLOURS[0], label="loss (left)")
    progress.set_xlabel("step of the search")
    progress.set_ylabel(r"loss $\log\langle C^2\rangle+\log\langle\dot C^2\rangle$")
    progress.set_title("Progress", fontsize=11)
    progress.grid(color="0.85")
    right = progress.twinx()
    right.semilogy(step, result.drift, color=COLOURS[1], linestyle="--", label="drift (right)")
    right.set_ylabel("largest |C| [m or rad]")
    lines = [*progress.get_lines(), *right.get_lines()]
    progress.legend(lines, [str(line.get_label()) for line in lines], fontsize=SMALL)
    return figure
