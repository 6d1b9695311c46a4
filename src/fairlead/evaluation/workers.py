"""Many trials in parallel processes."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence

from fairlead.core.workers import Ended, Tell, Workers
from fairlead.evaluation.bench import Bench, Job, Row, TrialsConfig


def run_jobs(config: TrialsConfig, jobs: Sequence[Job], workers: int) -> Generator[Row, None, None]:
    """The rows of the jobs as they end, from `workers` processes with one computing thread each.

    Closed early, by an error or an interrupt, it stops its processes; trials under way are lost.

    Raises:
        FairleadError: of a trial, or because a process died.
    """
    with Workers(_bench, config, workers) as pool:
        waiting = iter(jobs)
        for worker, job in zip(range(pool.count), waiting, strict=False):
            pool.begin(worker, job)
        for worker, answer in pool.answers():
            if answer is not Ended.JOB:
                yield answer
            elif (job := next(waiting, None)) is not None:
                pool.begin(worker, job)


def _bench(config: TrialsConfig) -> Callable[[Job, Tell], None]:
    bench = Bench(config)
    return lambda job, tell: tell(bench.run(job))
