"""Advice on the reduction to take, with the reason in words."""

import math
from collections.abc import Sequence

from .facts import Facts
from .row import ReductionRow

# A model counts as faster if its runs are so many times as fast as those of the full one.
_FASTER = 1.25
# So many times as fast is a little, beside what kinds that there was no time for may gain, or one
# that is wrong in what its error hides.
_LITTLE = 2.0
# The power of the error in the rank of a model, speed-up over that: a model that is ten times as
# accurate may be slower by a quarter.
_WORTH = 0.1
# A model with a larger error does not follow the motion at all, which needs an explanation.
WRONG = 0.1
# If the full model itself errs by this share of a model's error, the motion is unpredictable.
_CHAOTIC = 0.1


def paying(rows: Sequence[ReductionRow], tol: float) -> list[ReductionRow]:
    """Rows of models that are faster, and right on unseen starts, the best first; those whose
    errors hide what is wrong come last, since who takes the first one may ask it for anything.
    """
    good = [row for row in rows if row.error <= tol and row.speed_up >= _FASTER]

    def price(row: ReductionRow) -> tuple[bool, float]:
        return bool(row.hidden), -math.log(row.speed_up) + _WORTH * math.log(row.error)

    return sorted(good, key=price)


def in_order(rows: Sequence[ReductionRow], tol: float) -> list[ReductionRow]:
    """Sort rows: those that pay, then accurate ones, then the rest by their errors."""
    best = paying(rows, tol)
    accurate = [row for row in rows if row not in best and row.error <= tol]
    rest = [row for row in rows if row.error > tol]
    accurate.sort(key=lambda row: -row.speed_up)
    return [*best, *accurate, *sorted(rest, key=lambda row: row.error)]


def remark(trained: float, unseen: float, own: float, said: Sequence[str], hidden: str = "") -> str:
    """Say what speaks against a model.

    It may be its errors, what they hide, the error of the full model at the same tolerance, or
    flags of its run.
    """
    error = max(trained, 0.0 if math.isnan(unseen) else unseen)
    if error <= WRONG:
        return f"{hidden}, which is little beside the motion." if hidden else ""
    if math.isinf(trained):
        words = "its run fails"
    elif own > _CHAOTIC * error:
        words = f"the motion is chaotic, the full model itself errs by {own:.1e}"
    elif trained > WRONG:
        words = "wrong, even where it was trained"
    elif math.isinf(unseen):
        words = "cannot start, or fails, where it was not trained"
    else:
        words = "repeats its training, and is wrong elsewhere"
    told = "".join(said[:1]).partition("; ")[0].partition(". ")[0].rstrip(".")
    return f"{words}. {told[0].upper()}{told[1:]}." if told else f"{words}."


def advice(
    rows: Sequence[ReductionRow],
    full: ReductionRow,
    facts: Facts,
    tol: float,
    untried: str = "",
    judged: bool = True,
) -> str:
    """Say which model to take, or why none pays.

    `untried`: what was not tried, and what to do about it, in words; `judged`: whether there are
    runs that none has seen.
    """
    good = paying(rows, tol)
    if facts.rests:
        return (
            "Nothing moves from this start, so that there is no motion to reduce: give the "
            "mechanism a speed, a load or a drive."
        )
    if not rows:
        return "No model was made: all that were tried are refused, as is said below."
    if not good:
        why = _reason_beforehand(full, facts, tol)
        if untried and not why:
            return (
                "No verdict: none of the models that were tried is both right and faster, but "
                f"{untried}. {_nearest(rows, full, tol)}"
            )
        return f"Nothing pays here: {why or _reason(rows, full, facts, tol)}"
    best = good[0]
    kind = _KINDS.get(best.formulation, "") if best.rank else _KINEMATICS
    # Less than this is printed as one run.
    pays = f"{best.pays_after:.0f} runs" if best.pays_after >= 1.5 else "one run"
    where = "where it was not trained"
    if not judged:
        where = "on its training, since no other start or speed gives a run to judge it by"
    elif math.isnan(best.unseen):
        where = "on its training, the only run that it had time for"
    more = f" Others may gain more: {untried}." if untried and best.speed_up < _LITTLE else ""
    return (
        f"Take {best.name}: {best.speed_up:.1f} times as fast as the full model, and right to "
        f"{best.error:.0e} {where}; {kind} It pays after {pays}.{_hidden(good)}{more}"
    )


def _hidden(good: Sequence[ReductionRow]) -> str:
    """Say what the error of the best model hides; or which much faster one will do where what its
    error hides does not matter.
    """
    best, *others = good
    if best.hidden:
        return f" But the {best.hidden}, which matters for stresses and joint forces."
    least = _LITTLE * best.speed_up
    other = next((row for row in others if row.hidden and row.speed_up >= least), None)
    if other is None:
        return ""
    return (
        f" Where stresses and joint forces do not matter, {other.name} is "
        f"{other.speed_up:.1f} times as fast: its {other.hidden}."
    )


_KINEMATICS = "drives prescribe the motion, so that positions follow without any integration."
# Why a model of a kind is fast, by what is left out.
_KINDS = {
    "galerkin": "few modes of all coordinates leave out what is stiff.",
    "minimal": "the joints hold exactly, and no stiff direction is left.",
    "joint": "its joints hold exactly, by recursion from body to body.",
    "local": "its bodies keep the few shapes that the motion excites, and their joints.",
    "capped": "its fastest modes follow their loads, with no vibration of their own.",
    "table": "the configurations are looked up, no constraint is solved.",
    "hyper": "a few of its bodies stand for all.",
}


def _reason_beforehand(full: ReductionRow, facts: Facts, tol: float) -> str:
    """Give the reason why no model pays, whatever is tried; "" where only trials can tell."""
    if full.error > tol:
        return (
            "the motion is chaotic, so that no model predicts it for long: the full one itself "
            f"errs by {full.error:.0e} at this tolerance."
        )
    if not facts.modes and facts.freedoms == 0:
        return "the drives prescribe all of the motion; no equation of motion is left to solve."
    return ""


def _reason(rows: Sequence[ReductionRow], full: ReductionRow, facts: Facts, tol: float) -> str:
    """Give the reason for the advice, in a sentence of mechanics, once all kinds are tried."""
    faster = [row for row in rows if row.speed_up >= _FASTER]
    if facts.contacts and not any(row.error <= WRONG for row in faster):
        return (
            "impacts set the steps of every model alike, and what they excite is the motion that "
            "is wanted."
        )
    if facts.quick:
        return (
            f"a rigid mechanism that is not stiff has nothing to leave out; its {full.steps} steps "
            f"follow the motion itself, in {facts.freedoms} freedom{'s' * (facts.freedoms != 1)}."
        )
    if faster:
        best = min(faster, key=lambda row: row.error)
        return (
            "what is fast here is part of the motion; of the models that are faster the best "
            f"errs by {best.error:.0e} {_where(best)}."
        )
    if all(row.error > tol for row in rows):
        best = min(rows, key=lambda row: row.error)
        if math.isinf(best.error):
            return "no model that was tried is right; all of them fail."
        return (
            f"no model that was tried is right; the best errs by {best.error:.0e} {_where(best)}."
        )
    count = "one freedom takes" if facts.freedoms == 1 else f"{facts.freedoms} freedoms all take"
    return (
        f"its {count} part in the motion, and models that are right take as long as the full one, "
        f"whose {full.steps} steps follow it."
    )


def _nearest(rows: Sequence[ReductionRow], full: ReductionRow, tol: float) -> str:
    """Say how near the best model comes to one that pays: the fastest of those that are right."""
    right = [row for row in rows if row.error <= tol]
    if right:
        best = max(right, key=lambda row: row.speed_up)
        return (
            f"The fastest that is right, {best.name}, takes {best.steps} steps for the full "
            f"model's {full.steps}, and {1 / best.speed_up:.1f} times as long."
        )
    best = min(rows, key=lambda row: row.error)
    if math.isinf(best.error):
        return "Those that were tried fail."
    return (
        f"The most accurate, {best.name}, errs by {best.error:.0e} {_where(best)}, and takes "
        f"{best.steps} steps for the full model's {full.steps}."
    )


def _where(row: ReductionRow) -> str:
    """The runs that a model errs most on, of those that it was run on."""
    return "on starts that it has not seen" if row.unseen >= row.trained else "on its training"
