"""Kernels of notebooks that begin with what takes long to import."""

import multiprocessing
import os
from multiprocessing.context import ForkServerProcess
from typing import Any

from jupyter_client.manager import AsyncKernelManager

INLINE = "module://matplotlib_inline.backend_inline"
# Half of the start of a kernel is romjax with JAX, the other half the kernel and pyplot.
PRELOADED = ["ipykernel.kernelapp", "matplotlib.pyplot", "romjax"]


class _Process(ForkServerProcess):
    """A process with the names by which a manager of kernels asks."""

    stdin = stdout = stderr = None

    def poll(self) -> int | None:
        return self.exitcode

    def wait(self) -> int | None:
        self.join()
        return self.exitcode

    def send_signal(self, number: int) -> None:
        if self.is_alive() and self.pid:
            os.kill(self.pid, number)


class ForkedKernel(AsyncKernelManager):
    """Starts a kernel of Python by a fork of a process that has imported what all notebooks do,
    which spares each some seconds of a processor.
    """

    async def _async_launch_kernel(self, kernel_cmd: list[str], **settings: Any) -> None:
        multiprocessing.get_context("forkserver").set_forkserver_preload(PRELOADED)
        # Without what starts Python: the file of the connection, and options.
        options = kernel_cmd[kernel_cmd.index("-f") :]
        process = _Process(target=_serve, args=(options, settings["env"], settings["cwd"]))
        process.start()
        # The provisioner asks and ends it as if it had started it.
        self.provisioner.process, self.provisioner.pid = process, process.pid


def _serve(options: list[str], environment: dict[str, str], folder: str) -> None:
    """A kernel, until it is told to end."""
    import matplotlib as mpl
    from ipykernel.kernelapp import launch_new_instance

    os.environ.update(environment)
    os.chdir(folder)
    # What a kernel sets in the environment is read when matplotlib is imported, before the fork.
    mpl.rcParams["backend"] = os.environ.setdefault("MPLBACKEND", INLINE)
    # It ends with the process that it was forked from.
    launch_new_instance([*options, f"--IPKernelApp.parent_handle={os.getppid()}"])
