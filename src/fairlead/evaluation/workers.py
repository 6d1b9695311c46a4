"""Many trials in parallel processes, which end with the run, and with the process that started them."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING

from fairlead.core.errors import FairleadError

if TYPE_CHECKING:
    from fairlead.evaluation.bench import Job, Row, TrialsConfig


def run_jobs(config: TrialsConfig, jobs: Sequence[Job], workers: int) -> Generator[Row, None, None]:
    """The rows of the jobs as they end, from `workers` processes with one computing thread each.

    Closed early, by an error or an interrupt, it stops its processes, and no others; trials under way are lost.

    Raises:
        FairleadError: of a trial, or because a process died.
    """
    if workers < 1:
        raise FairleadError(f"workers {workers}: at least 1 is needed")
    os.environ["OMP_NUM_THREADS"] = "1"  # read by numpy and torch when the processes start
    waiting = iter(jobs)
    pipes: dict[Connection, BaseProcess] = {}
    try:
        for job in itertools.islice(waiting, workers):
            pipe, process = _started(config)
            pipes[pipe] = process
            pipe.send(job)
        busy = list(pipes)
        while busy:
            for pipe in wait(busy):
                assert isinstance(pipe, Connection)
                row, job = _received(pipe, pipes[pipe]), next(waiting, None)
                if job is None:
                    busy.remove(pipe)
                else:
                    with suppress(OSError):  # a worker that died in between is found when it is waited for
                        pipe.send(job)
                yield row
    finally:
        for process in pipes.values():
            process.terminate()
        for process in pipes.values():
            process.join()


def _started(config: TrialsConfig) -> tuple[Connection, BaseProcess]:
    """A new worker, and our end of the pipe to it."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs,), daemon=True)
    process.start()
    theirs.close()
    ours.send(config)
    return ours, process


def _received(pipe: Connection, process: BaseProcess) -> Row:
    """What a worker has sent."""
    try:
        found = pipe.recv()
    except (EOFError, OSError):
        process.join()
        raise FairleadError(
            f"a worker process died (exit code {process.exitcode}); the same command goes on with what is missing"
        ) from None
    if isinstance(found, FairleadError):
        raise found
    return found


def _work(pipe: Connection) -> None:
    """A worker: receives a configuration, builds its bench, and runs one trial after another as they are asked for."""
    # An interrupt from the keyboard reaches every process; the parent alone answers it, and stops its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    from fairlead.evaluation.bench import Bench  # takes seconds, and the parent is watched already

    try:
        bench = Bench(pipe.recv())
        while True:
            pipe.send(bench.run(pipe.recv()))
    except EOFError:
        return  # nobody is there to ask
    except FairleadError as error:
        # An error with a constructor of its own cannot travel between processes; its sentence can.
        pipe.send(FairleadError(str(error)))


def _leave_with_parent() -> None:
    """A worker whose parent was killed must not write on into a folder that another run may have taken over."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
