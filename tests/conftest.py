"""Settings of all tests; what they need of JAX is in `costs.py`."""

import gc

import cache_folder  # noqa: F401  what is imported before it is not kept
from groups import longest_first, one_group_each

# Objects after which Python looks for cycles among the youngest. Imports and tracing make millions
# of objects and hardly a cycle: looking after every 700 takes a tenth of all time, a fifth of it
# where JAX is imported.
COLLECT_AFTER = 50_000
gc.set_threshold(COLLECT_AFTER, 20, 100)


def pytest_configure(config):
    """Import JAX, unless this process only hands out the tests to others: it starts them sooner."""
    if config.getoption("dist", "no") == "no" or config.option.collectonly:
        config.pluginmanager.import_plugin("costs")


def pytest_collection_modifyitems(items):
    """Begin with what takes longest; refuse a test that two groups would run."""
    one_group_each(items)
    longest_first(items)
