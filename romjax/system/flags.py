"""Flags: reasons to doubt the result of a simulation, as numbers that JAX can carry."""

import enum


class Flag(enum.IntFlag):
    """Reasons not to trust a simulated motion."""

    NONE = 0
    OUTSIDE_TRAINING = 1
    VIOLATION = 2
    ENERGY = 4
    DISSIPATION = 8
    BRANCH = 16
    RESOLUTION = 32
    LIMIT = 64
    WEIGHTS = 128
    CAPPED = 256
    LEFT_OUT = 512
    ESTIMATE = 1024
    UNTRIED = 2048
    PHASE = 4096
    UNMODELLED = 8192


WORDS = {
    Flag.OUTSIDE_TRAINING: "it leaves the box of the snapshots that the reduced model was made of",
    Flag.VIOLATION: "it violates the constraints by more than the snapshots in the basis do",
    Flag.ENERGY: "its energy changes by more than the work of the forces",
    Flag.DISSIPATION: "its dampers give energy instead of taking it",
    Flag.BRANCH: "it passes a singular position so closely that it may have changed its branch",
    Flag.RESOLUTION: "its tolerances are hardly smaller than the motion itself",
    Flag.PHASE: "its bodies turn, swing or bounce so many times that errors of their speed add up "
    "to more than 100 rtol, and 1e-4, of a radian or of how far they get, or 0.05 in fixed steps",
    Flag.LIMIT: "an effect passes the end of what it is right for, as a bushing after half a turn",
    Flag.WEIGHTS: "its sampled bodies, whose weights are for other masses, have another energy",
    Flag.CAPPED: "modes above the cap vibrate, which they do at the cap and not as they should",
    Flag.LEFT_OUT: "its model errs by more than 100 rtol, and 1e-4, or by a tenth of how one body "
    "moves or bends, on the motions that it was made of",
    Flag.UNTRIED: "it is none of the motions that its model was made of, which errs by more on "
    "these than 30 rtol, and 1e-5; romjax.corrected tells its error",
    Flag.UNMODELLED: "forces act on it that move the mechanism out of its model, by an estimate so "
    "far that it errs by more than 100 rtol, and 1e-4; romjax.corrected tells its error",
    Flag.ESTIMATE: "the reduced run that it corrects is wrong by more than 5 %: not to be used",
}
