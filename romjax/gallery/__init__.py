"""Ready scenes, by name."""

from .cart_pendulum import cart_pendulum as cart_pendulum
from .catalogue import EXAMPLES as EXAMPLES
from .catalogue import Example as Example
from .catalogue import find as find
from .chain import chain as chain
