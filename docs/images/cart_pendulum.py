"""Draws the README's moving picture: `python docs/images/cart_pendulum.py [FILE]`."""

import sys
from pathlib import Path

import jax
import numpy as np

import romjax as rj

if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    # Slower than the chapter's force, near the frequency of the springs, so that one sees it move.
    scene = rj.gallery.cart_pendulum(force=6.0, frequency=2.0)
    system = rj.assemble(scene)
    ts = np.linspace(0.0, 2.0, 601)
    full = rj.simulate(system, ts)
    reduced = rj.simulate(rj.reduce(system, rj.pod(full, rank=3), rj.Minimal()), ts)
    moving = rj.animate(
        scene, full, reduced, labels=["full: 8 coordinates", "reduced: 3 coordinates"]
    )
    target = sys.argv[1] if sys.argv[1:] else Path(__file__).with_suffix(".gif")
    moving.save(target, fps=10, seconds=4)
