"""Frequency responses of linear models."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ...analysis.linearization import LinearModel
from ...common.checks import check_kind
from ..style import SMALL, DisplayedFigure, line

POINTS = 801
DECADE = 10.0


def bode(*models: LinearModel, omega: Any = None, labels: Sequence[str] | None = None) -> Figure:
    """Magnitude and phase of C (iω − A)⁻¹ B + D against ω, a pair of panels for each input.

    The magnitude in dB, 20 log₁₀ of the ratio of amplitudes in SI units; the phase in degrees,
    without jumps. A line for each output, and of several models, such as one of a full and one of a
    reduced system, dashed ones over the first.

    **Arguments:**

    - `models`: of `romjax.linearize`, with the same inputs and outputs.
    - `omega`: angular frequencies (k,) [rad/s], positive; unless given, from a tenth of the lowest
      natural frequency to ten times the highest.
    - `labels`: names of the models.

    Raises ValueError without a model, for models of other inputs or outputs, for labels that do not
    fit, or for frequencies that are not positive.
    """
    if not models:
        raise ValueError("bode: no model given; pass some, such as bode(romjax.linearize(…)).")
    for model in models:
        check_kind("bode", "a model", model, (LinearModel,), "what romjax.linearize returns")
    first = models[0]
    for model in models[1:]:
        if (model.inputs, model.outputs) != (first.inputs, first.outputs):
            raise ValueError(
                f"bode: the models have inputs {first.inputs} and outputs {first.outputs}, and "
                f"{model.inputs} and {model.outputs}; linearize both with the same ones."
            )
    names = [f"model {i + 1}" for i in range(len(models))] if labels is None else [*labels]
    if len(names) != len(models):
        raise ValueError(f"bode: {len(names)} labels for {len(models)} models; give one for each.")
    at = _frequencies(models) if omega is None else np.asarray(omega, float)
    if at.ndim != 1 or not at.size or not np.all(at > 0):
        raise ValueError(
            f"bode: omega has shape {at.shape} and must be positive angular frequencies (k,) "
            "[rad/s], such as jnp.geomspace(0.1, 100.0, 500)."
        )
    return _drawn(models, names, at)


def _frequencies(models: Sequence[LinearModel]) -> np.ndarray:
    sizes = np.abs(np.concatenate([np.linalg.eigvals(np.asarray(m.A)) for m in models]))
    known = sizes[sizes > 1e-9 * np.max(sizes, initial=0.0)]
    low, high = (np.min(known), np.max(known)) if known.size else (1.0, 1.0)
    return np.geomspace(low / DECADE, high * DECADE, POINTS)


def _drawn(models: Sequence[LinearModel], names: Sequence[str], at: np.ndarray) -> Figure:
    inputs, outputs = models[0].inputs, models[0].outputs
    figure = DisplayedFigure(figsize=(1.5 + 4.5 * len(inputs), 5.0))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(2, len(inputs), sharex=True, squeeze=False)
    responses = [np.asarray(model.frequency_response(at)) for model in models]
    for column, name in enumerate(inputs):
        size, phase = panels[:, column]
        for number, (response, model) in enumerate(zip(responses, names, strict=True)):
            for row, output in enumerate(outputs):
                values = response[:, row, column]
                style = line(row) | {"linestyle": line(number)["linestyle"]}
                label = output if len(models) == 1 else f"{output}, {model}"
                # A response of zero is at no level.
                level = 20 * np.log10(np.where(values == 0, np.nan, np.abs(values)))
                size.plot(at, level, label=label, **style)
                phase.plot(at, np.degrees(np.unwrap(np.angle(values))), **style)
        size.set_title(f"input: {name}", fontsize=SMALL + 2)
        phase.set_xlabel("angular frequency ω [rad/s]")
        for axes in (size, phase):
            axes.set_xscale("log")
            axes.grid(color="0.9")
    panels[0, 0].set_ylabel("magnitude [dB]")
    panels[1, 0].set_ylabel("phase [°]")
    panels[0, -1].legend(fontsize=SMALL + 1)
    return figure
