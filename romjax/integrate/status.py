"""How a simulation ended, and what helps."""

import enum


class Status(enum.IntEnum):
    """How a simulation ended."""

    SUCCESS = 0
    MAX_STEPS = 1
    NOT_FINITE = 2
    INCONSISTENT_START = 3
    SOLVER_FAILED = 4
    PRECISION = 5
    CONSTRAINTS_VIOLATED = 6
    MAX_EVENTS = 7
    CONTACT_LASTS = 8
    NEGATIVE_MASS = 9


REMEDIES = {
    Status.SUCCESS: "",
    Status.MAX_STEPS: "the solver used up max_steps, or the steps that dense output has room for; "
    "loosen rtol and atol, raise max_steps or dense, "
    "or use a solver for stiff systems such as romjax.Rodas5P()",
    Status.NOT_FINITE: "the motion became infinite or NaN; the system is unstable, the mechanism "
    "passes a singular position, a beam with stiffening bends as far as it is long, or the step is "
    "too long",
    Status.INCONSISTENT_START: "the start violates the constraints; "
    "use romjax.consistent_scene(scene), or q0, v0 = romjax.consistent(system, q0, v0)",
    Status.PRECISION: "single precision cannot solve for the joint forces of this mechanism: the "
    "masses that a joint connects differ by 1e4 or more, or two joints nearly repeat each other; "
    'call jax.config.update("jax_enable_x64", True) before making any array',
    Status.CONSTRAINTS_VIOLATED: "not all joints hold on the way; look at the trajectory's "
    "violation, take out joints that contradict each other, tighten rtol, or shorten fixed steps",
    Status.MAX_EVENTS: "more happened than there is room for; raise max_events, or watch for less",
    Status.CONTACT_LASTS: "bodies overlap at the start or stay in contact after an impact, or "
    "impacts follow one another without end; end the run there by a romjax.Stop, or use a "
    "romjax.Contact instead",
    Status.NEGATIVE_MASS: "a mass or a moment of inertia is negative at the start; bound the "
    "numbers that are tried, or try logarithms of them",
    Status.SOLVER_FAILED: "the solver failed inside a step; try another solver",
}
