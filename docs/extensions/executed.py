"""Where the results of long executions are kept: one folder for each state of the package."""

import hashlib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def _digest() -> str:
    """Of all files of the package: with any other, results may be other ones."""
    files = sorted((ROOT / "romjax").rglob("*"))
    files = [path for path in files if path.is_file() and path.suffix != ".pyc"]
    whole = hashlib.sha256()
    for path in files:
        whole.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return whole.hexdigest()[:16]


FOLDER = ROOT / "build" / "executed" / _digest()
