"""Runs a script in a process of its own, which begins with what takes long to import."""

import multiprocessing
import os
import warnings
from concurrent.futures import ProcessPoolExecutor


def processes() -> ProcessPoolExecutor:
    """One process after the other, each forked from one that has imported romjax."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["matplotlib.figure", "romjax"])
    return ProcessPoolExecutor(1, context, max_tasks_per_child=1)


def run(script: str, folder: str) -> None:
    """As Python does in a folder, where warnings are errors."""
    os.chdir(folder)
    warnings.simplefilter("error")
    exec(compile(script, "page.py", "exec"), {"__name__": "__main__"})
