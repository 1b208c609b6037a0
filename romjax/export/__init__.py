"""Exports of systems that run elsewhere: `romjax.export`."""

from .exported import Exported as Exported
from .exported import c as c
from .fmu import ExportedFMU as ExportedFMU
from .fmu import fmu as fmu
from .stablehlo import ExportedRun as ExportedRun
from .stablehlo import stablehlo as stablehlo
