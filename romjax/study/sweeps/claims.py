"""Claims of processes to parts of one work, as files of a folder that all of them see."""

import contextlib
import json
import os
import secrets
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# [s] A claim is renewed so often as long as its process runs, and void when it is older than that.
BEAT, VOID = 5.0, 60.0
# Beats that may be missing, as a network folder tells of them late, for who has nothing else to do.
_MISSED = 4


class Claims:
    """The claims of this process, which a thread renews as long as the process runs.

    A claim is a file that only one process can create. Void ones, of processes that died or have
    been stopped, are taken over. A process that goes on after that computes what another one has
    computed as well, which costs time but no result.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self.owner = {"host": socket.gethostname(), "pid": os.getpid(), "key": secrets.token_hex(8)}

    def _file(self, number: int) -> Path:
        return self.folder / f"claim-{number:06d}.json"

    @contextlib.contextmanager
    def held(self, number: int, idle: bool = False) -> Iterator[bool]:
        """Whether a part is this process's own within the context; sooner if this one is `idle`."""
        file = self._file(number)
        limit = min(VOID, _MISSED * BEAT) if idle else VOID
        if not (self._created(file) or (self._is_void(file, limit) and self._taken_over(file))):
            yield False
            return
        done = threading.Event()
        beat = threading.Thread(target=self._renew, args=(file, done), daemon=True)
        beat.start()
        try:
            yield True
        finally:
            done.set()
            beat.join()
            if self._is_own(file):
                file.unlink(missing_ok=True)

    def clear(self) -> None:
        """Delete what processes that ended between a result and its claim have left."""
        for file in self.folder.glob("claim-*.json"):
            with contextlib.suppress(OSError):
                file.unlink()

    def _created(self, file: Path) -> bool:
        try:
            with file.open("x") as stream:
                json.dump(self.owner, stream)
        except FileExistsError:
            return False
        return True

    def _is_void(self, file: Path, limit: float) -> bool:
        """Whether nobody works on a claim any more: nobody renews it, or its process has ended."""
        try:
            age = self._now() - file.stat().st_mtime
        except FileNotFoundError:
            return True
        owner = _owner(file)
        here = owner.get("host") == self.owner["host"]
        return age > limit or (here and not _runs(owner.get("pid")))

    def _taken_over(self, file: Path) -> bool:
        """Whether the claim in the place of a void one is this process's."""
        void = file.with_suffix(f".{self.owner['key']}")
        # One of several processes can move it; whoever comes too late finds none, or a new one.
        with contextlib.suppress(FileNotFoundError):
            file.replace(void)
            void.unlink()
        return self._created(file)

    def _is_own(self, file: Path) -> bool:
        return _owner(file) == self.owner

    def _renew(self, file: Path, done: threading.Event) -> None:
        while not done.wait(BEAT):
            if self._is_own(file):
                with contextlib.suppress(OSError):
                    os.utime(file)

    def _now(self) -> float:
        """The time by the clock of the folder, which may be that of another machine."""
        mark = self.folder / f".romjax-{self.owner['key']}.part"
        try:
            mark.touch()
            return mark.stat().st_mtime
        finally:
            mark.unlink(missing_ok=True)


def _owner(file: Path) -> dict[str, Any]:
    """Read what a claim says of its process; empty if it is gone or not yet written."""
    try:
        content = json.loads(file.read_bytes())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _runs(pid: Any) -> bool:
    """Whether there is a process of that number on this machine."""
    try:
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return False
    except (OSError, TypeError, ValueError):  # another user's, or no number
        return True
    return True
