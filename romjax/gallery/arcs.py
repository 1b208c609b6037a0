"""Rods bent to arcs of circles."""

import numpy as np

from ..scene.body.rod import Rod


def arc(straight: Rod, angle: float) -> list[float]:
    """The amplitudes at which a rod is an arc of this angle [rad] from start to end, of a rod whose
    shapes hold a constant curvature.
    """
    basis = np.asarray(straight.strains.basis)
    constant = angle * np.eye(len(basis))[0]
    amplitudes = np.linalg.lstsq(basis, constant, rcond=None)[0]
    # Zeros without a sign, which hangs on the processor.
    return [round(amplitude, 12) + 0.0 for amplitude in amplitudes.tolist()]
