"""Where the tests keep what is compiled, for their next run and for the processes that they start.

The first import of `conftest.py`, before JAX: what is imported before it is not kept.
"""

import os
import sys

from platformdirs import user_cache_path

# Of programs; apart from the user's own, which they would push out.
FOLDER = os.environ.setdefault("ROMJAX_CACHE_DIR", str(user_cache_path("romjax") / "tests"))

# Where Python may write no bytecode beside the sources, each of some twenty processes would compile
# all modules of JAX, diffrax and romjax again, for two to six seconds. The name that stands there
# already, be it empty, is a wish.
if FOLDER and sys.dont_write_bytecode and "PYTHONPYCACHEPREFIX" not in os.environ:
    sys.pycache_prefix = os.environ["PYTHONPYCACHEPREFIX"] = f"{FOLDER}-bytecode"
    sys.dont_write_bytecode = False
    # By `python -B` too it is not written, and nothing stands there.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
