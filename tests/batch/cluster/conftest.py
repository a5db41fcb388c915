"""A cluster for tests: its workers are threads of this process."""

from collections.abc import Iterator
from contextlib import contextmanager

import distributed
import pytest


@contextmanager
def cluster(workers: int = 1) -> Iterator[str]:
    """The address of a scheduler with workers that are threads of this process."""
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1",
        dashboard_address="127.0.0.1:0", memory_limit=0, silence_logs=100,
    ) as local:  # fmt: skip
        yield local.scheduler_address


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The address of a scheduler with two of them."""
    with cluster(2) as found:
        yield found
