"""Ready scenes, by name."""

from .cart_pendulum import cart_pendulum as cart_pendulum
from .chain import chain as chain
