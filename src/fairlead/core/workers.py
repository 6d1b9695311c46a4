"""Parallel processes that end with the run, and with the process that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator
from contextlib import suppress
from enum import Enum
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from pickle import PicklingError
from typing import Any, final

from fairlead.core.errors import FairleadError

Tell = Callable[[Any], None]
Serve = Callable[[Any], Callable[[Any, Tell], None]]
"""Called once in a worker with what all are given; the result, with each job and a function that sends an answer."""
THREADS = "OMP_NUM_THREADS"


class Ended(Enum):
    """The last answer to a job."""

    JOB = "job"


def travels(given: Any) -> bool:
    """Whether another process can be given this: asked of what writes to pipes between processes, and to no file."""
    try:
        ForkingPickler.dumps(given)
    except (PicklingError, AttributeError, TypeError):
        return False
    return True


@final
class Workers:
    """Processes in each of which numpy and torch compute on one thread, started when they are needed.

    As a context it stops them in the end, and no others.

    Args:
        serve: what a worker does, a function of a module.
        given: what `serve` is called with; it `travels`.
        count: how many.

    Raises:
        FairleadError: there is to be none.
    """

    def __init__(self, serve: Serve, given: Any, count: int) -> None:
        if count < 1:
            raise FairleadError(f"workers {count}: at least 1 is needed")
        self.count, self._setup = count, (serve, given)
        self._pipes: dict[int, Connection] = {}
        self._processes: dict[int, BaseProcess] = {}
        self._busy: dict[Connection, int] = {}

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes.values():
            process.terminate()
        for process in self._processes.values():
            process.join()

    def begin(self, worker: int, job: Any) -> None:
        """Give a job to the worker of this number, 0 to `count` - 1, which has nothing to do."""
        if worker not in self._pipes:
            self._start(worker)
            self._send(worker, self._setup)
        self._send(worker, job)
        self._busy[self._pipes[worker]] = worker

    def _send(self, worker: int, message: Any) -> None:
        with suppress(OSError):  # a worker that died in between is found when it is waited for
            self._pipes[worker].send(message)

    def _start(self, worker: int) -> None:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs,), daemon=True)
        before = os.environ.get(THREADS)
        os.environ[THREADS] = "1"  # read by numpy and torch when the process starts
        try:
            process.start()
        finally:
            os.environ.pop(THREADS)
            os.environ.update({} if before is None else {THREADS: before})
        theirs.close()
        self._pipes[worker], self._processes[worker] = ours, process

    def answers(self) -> Generator[tuple[int, Any]]:
        """Each worker's answers as they come, `Ended.JOB` the last to a job, until no worker is busy.

        Raises:
            FairleadError: of a job, or because a process died.
        """
        while self._busy:
            for pipe in wait(list(self._busy)):
                assert isinstance(pipe, Connection)
                worker = self._busy[pipe]
                answer = self._received(worker)
                if answer is Ended.JOB:
                    del self._busy[pipe]
                yield worker, answer

    def _received(self, worker: int) -> Any:
        process = self._processes[worker]
        try:
            found = self._pipes[worker].recv()
        except (EOFError, OSError):
            process.join()
            code = process.exitcode or 0
            what = "the same command goes on with what is missing" if code < 0 else "it said why, above"
            raise FairleadError(f"a worker process died (exit code {code}); {what}") from None
        if isinstance(found, FairleadError):
            raise found
        return found


def _work(pipe: Connection) -> None:
    """A worker: one job after another, until nobody is there to ask."""
    # An interrupt from the keyboard reaches every process; the parent alone answers it, and stops its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    try:
        serve, given = pipe.recv()  # imports what takes seconds; the parent is watched already
        do = serve(given)
        while True:
            do(pipe.recv(), pipe.send)
            pipe.send(Ended.JOB)
    except (EOFError, ConnectionError):
        return
    except FairleadError as error:
        # An error with a constructor of its own cannot travel between processes; its sentence can.
        pipe.send(FairleadError(str(error)))


def _leave_with_parent() -> None:
    """A worker whose parent was killed must not write on into a folder that another run may have taken over."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
