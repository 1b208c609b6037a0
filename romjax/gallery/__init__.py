"""Ready scenes, by name."""

from .bouncing_ball import bouncing_ball as bouncing_ball
from .cart_pendulum import cart_pendulum as cart_pendulum
from .catalogue import EXAMPLES as EXAMPLES
from .catalogue import Example as Example
from .catalogue import find as find
from .chain import chain as chain
from .connecting_rod import connecting_rod as connecting_rod
from .double_pendulum import double_pendulum as double_pendulum
from .flywheel import flywheel as flywheel
from .four_bar import four_bar as four_bar
from .jansen import jansen as jansen
from .newtons_cradle import newtons_cradle as newtons_cradle
from .robot_arm import robot_arm as robot_arm
from .rotating_blade import rotating_blade as rotating_blade
from .segmented_beam import segmented_beam as segmented_beam
from .slider_crank import slider_crank as slider_crank
from .squeezer import squeezer as squeezer
from .trebuchet import trebuchet as trebuchet
from .vehicle_axle import vehicle_axle as vehicle_axle
