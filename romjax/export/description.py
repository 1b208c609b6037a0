"""The model description of an FMU, by the schema of FMI 3.0."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ..analysis.linearization import Output
from ..common.errors import InputError
from ..scene.coordinate import INTEGRAL, Coordinate
from .leaving import Model

_BASE = ("kg", "m", "s", "rad")
_FACTOR = re.compile(r"(\w+?)(?:\^(-?\d+))?")


class Variable(NamedTuple):
    """A number of an FMU: its name, and the attributes that the standard gives it."""

    name: str
    attributes: Mapping[str, str]
    unit: str = ""


class Variables(NamedTuple):
    """All variables, in the order of their references.

    - `name`: of the model. `states`: names. `shown`: states that are outputs.
    - `computed`: outputs that are no states. `time`: when the start holds [s].
    """

    name: str
    states: tuple[str, ...]
    shown: frozenset[str]
    computed: Mapping[str, Output]
    variables: tuple[Variable, ...]
    time: float

    @classmethod
    def of(cls, model: Model, name: str) -> "Variables":
        """The variables of a model; raise InputError where two have one name."""
        coordinates = model.nominal.structure.coordinates
        rated = [coordinate.label for coordinate in coordinates]
        # An output that is a state of a full system needs no variable of its own; a coordinate of a
        # reduced one that is called as a body's is another number.
        is_full = model.nominal.full is model.nominal
        taken = set() if is_full else {*model.outputs}
        rated = [f"own.{label}" if {label, f"{label}'"} & taken else label for label in rated]
        states = (*rated, *(f"{label}'" for label in rated))
        shown = frozenset(key for key, x in model.outputs.items() if is_full and key == x) & {
            *states
        }
        computed = {key: x for key, x in model.outputs.items() if key not in shown}
        plain = [_integrated_unit(coordinate) for coordinate in coordinates]
        units = dict(zip(states, [*plain, *map(_rate, plain)], strict=True))
        full = _units_of(model.nominal.full.structure.coordinates)
        variables = [
            Variable("time", {"causality": "independent", "variability": "continuous"}, "s")
        ]
        for label, value in zip(states, model.start().tolist(), strict=True):
            causality = "output" if label in shown else "local"
            given = {"causality": causality, "variability": "continuous", "initial": "exact"}
            variables.append(Variable(label, given | {"start": repr(value)}, units[label]))
        for k, label in enumerate(states, 1):
            given = {"causality": "local", "variability": "continuous", "initial": "calculated"}
            unit = _rate(units[label])
            variables.append(Variable(f"der({label})", given | {"derivative": str(k)}, unit))
        for label in model.inputs:
            given = {"causality": "input", "variability": "continuous", "start": "0.0"}
            variables.append(Variable(label, given))
        for label, value in model.parameters.items():
            given = {"causality": "parameter", "variability": "tunable", "initial": "exact"}
            variables.append(Variable(label, given | {"start": repr(float(value))}))
        for label, what in computed.items():
            given = {"causality": "output", "variability": "continuous", "initial": "calculated"}
            unit = full.get(what, "") if isinstance(what, str) else ""
            variables.append(Variable(label, given, unit))
        names = [variable.name for variable in variables]
        if twice := sorted({x for x in names if names.count(x) > 1}):
            raise InputError(
                f"export.fmu: there are several variables of the name {twice[0]!r}; states, "
                "inputs, parameters and outputs need names of their own."
            )
        return cls(name, states, shown, computed, tuple(variables), model.time)


def _units_of(coordinates: tuple[Coordinate, ...]) -> dict[str, str]:
    """The units of coordinates and their rates, by their labels."""
    known = {x.label: _integrated_unit(x) for x in coordinates}
    return known | {f"{label}'": _rate(unit) for label, unit in known.items()}


def _integrated_unit(coordinate: Coordinate) -> str:
    """The unit of a coordinate as models integrate it: of a state, that of its integral."""
    is_integral = coordinate.unit and coordinate.name.startswith(INTEGRAL)
    return f"{coordinate.unit} s" if is_integral else coordinate.unit


def _rate(unit: str) -> str:
    if not unit:
        return ""
    return unit[:-2] + "/s2" if unit.endswith("/s") else unit + "/s"


def model_description(variables: Variables, token: str) -> str:
    """The text of modelDescription.xml."""
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=variables.name,
        instantiationToken=token,
        generationTool="romjax",
        variableNamingConvention="flat",
    )
    able = dict.fromkeys(("canGetAndSetFMUState", "canSerializeFMUState"), "true")
    able |= dict.fromkeys(("providesDirectionalDerivatives", "providesAdjointDerivatives"), "true")
    ET.SubElement(root, "ModelExchange", able, modelIdentifier=variables.name)
    able["canHandleVariableCommunicationStepSize"] = "true"
    ET.SubElement(root, "CoSimulation", able, modelIdentifier=variables.name)
    units = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({x.unit for x in variables.variables if x.unit}):
        each = ET.SubElement(units, "Unit", name=unit)
        if (base := _base_unit(unit)) is not None:
            ET.SubElement(each, "BaseUnit", base)
    categories = ET.SubElement(root, "LogCategories")
    for category in ("logStatusError", "logStatusWarning"):
        ET.SubElement(categories, "Category", name=category)
    begin, end = repr(variables.time), repr(variables.time + 1.0)
    ET.SubElement(root, "DefaultExperiment", startTime=begin, stopTime=end, tolerance="1e-6")
    each = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables.variables):
        given = {"name": variable.name, "valueReference": str(reference), **variable.attributes}
        ET.SubElement(each, "Float64", given | ({"unit": variable.unit} if variable.unit else {}))
    structure = ET.SubElement(root, "ModelStructure")
    for kind, reference, dependencies in _structure(variables):
        needed = " ".join(map(str, dependencies))
        ET.SubElement(structure, kind, valueReference=str(reference), dependencies=needed)
    return _text(root)


def _structure(variables: Variables) -> Iterator[tuple[str, int, list[int]]]:
    """List what the unknowns depend on; in the run, where parameters are no unknowns, and at the
    start.

    The rates of positions are the velocities, and no output depends on an input: so importers
    find no loops where there are none. All is said, since some importers read no default.
    """
    count = len(variables.states)
    states = range(1, count + 1)
    inputs, outputs, parameters = (
        [k for k, x in enumerate(variables.variables) if x.attributes["causality"] == causality]
        for causality in ("input", "output", "parameter")
    )
    for k in outputs:
        yield "Output", k, [k] if k in states else [0, *states]
    velocities = {count + k: [count // 2 + k] for k in range(1, count // 2 + 1)}
    derivatives = range(count + 1, 2 * count + 1)
    for k in derivatives:
        yield "ContinuousStateDerivative", k, velocities.get(k, [0, *states, *inputs])
    for k in [*derivatives, *(k for k in outputs if k not in states)]:
        yield "InitialUnknown", k, velocities.get(k, [0, *states, *inputs, *parameters])


def _base_unit(unit: str) -> dict[str, str] | None:
    """The powers of base units; None where they are no whole numbers."""
    over, _, under = unit.partition("/")
    powers: dict[str, int] = {}
    under = re.sub(r"^s2$", "s^2", under)
    for part, sign in ((over, 1), (under, -1)):
        for factor in part.split():
            match = _FACTOR.fullmatch(factor)
            if match is None or match[1] not in _BASE:
                return None
            powers[match[1]] = powers.get(match[1], 0) + sign * int(match[2] or 1)
    return {key: str(power) for key, power in powers.items()}


def build_description(name: str) -> str:
    """The text of buildDescription.xml."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    each = ET.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    sources = ET.SubElement(each, "SourceFileSet", language="C99")
    ET.SubElement(sources, "SourceFile", name=f"{name}.c")
    ET.SubElement(each, "Library", name="m")
    return _text(root)


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
