"""What leaves to run elsewhere: `romjax.export`."""

from .exported import Exported as Exported
from .exported import c as c
