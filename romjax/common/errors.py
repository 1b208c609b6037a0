"""The exceptions of romjax; each message names the culprit, its value and the remedy."""


class InputError(ValueError):
    """An argument that cannot be used: a wrong shape, a number out of range, …

    - `message`: what, where, the value and the remedy.
    - `field`: name of the argument or field at fault, empty where there is more than one; files
      find the key that it came from by it.
    - `part`: what has the field, as messages have it, such as "joint 'hinge'"; empty where that is
      known to whoever asks.
    """

    def __init__(self, message: str, *, field: str = "", part: str = ""):
        super().__init__(message)
        self.field, self.part = field, part


class SceneError(InputError):
    """A scene that cannot be assembled."""


class SceneFileError(SceneError):
    """A file that holds no scene; the message has a line for each of its mistakes."""


class RankError(InputError):
    """A number of modes that the snapshots do not allow."""


class ReductionError(ValueError):
    """A basis that does not make a reduced model."""


class UnsuitedError(ReductionError):
    """A formulation that cannot take a system; `reduce` goes on with one that does."""


class SimulationError(RuntimeError):
    """A simulation that failed."""
