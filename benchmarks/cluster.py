"""What a cluster gains: two workers beside one on this machine, what a part costs beside its rendering, 1000 workers.

    python -m benchmarks.cluster [--json FILE]

Each worker has one core. Where other programs run, the ratio of times says little, and that of CPU times still holds:
without them, two workers are as many times faster as two is over it, if the cores do not slow each other.

The costs are measured here; larger clusters are a discrete model with these costs: workers take parts as they become
free, the client takes parts in one after the other, and a picture ends with its last part.
"""

from __future__ import annotations

import heapq
import os
import resource
import statistics
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import distributed
import numpy as np

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.batch import cluster_run
from rptcam_cl.batch.cluster import workers_here
from rptcam_cl.batch.cluster_run import render_on_cluster
from rptcam_cl.device.devices import choose_device

SCENE = Path(__file__).resolve().parents[1] / "examples" / "first_light.yaml"
WORKERS = (1, 10, 30, 100, 300, 1000)
HOURS = (1, 10, 100)  # of one worker


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """A scheduler with workers of one core each, which have rendered before."""
    with workers_here(workers, threads=1) as found:
        yield found.scheduler_address


@dataclass(frozen=True)
class Costs:
    """Of a part: at the client and scheduler [s of CPU time], beside the rendering at the worker [s], its spread; of a
    worker: until it renders [s].
    """

    client: float
    worker: float
    spread: float
    start: float


@dataclass(frozen=True)
class Rendered:
    """A render on a cluster: how long it took [s], CPU time of this process and of all workers [s], its account."""

    seconds: float
    client_cpu: float
    workers_cpu: float
    account: dict[str, Any]

    @property
    def parts_s(self) -> float:
        """What workers took for all parts together [s]."""
        return sum(row["seconds"] for row in self.account["workers"].values())


def cpu_of_worker() -> float:
    """Return the CPU time of a process so far [s]."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return float(used.ru_utime + used.ru_stime)


def render(address: str, **words: Any) -> Rendered:
    """Render on a cluster."""
    with distributed.Client(address, set_as_default=False) as client:
        before = sum(client.run(cpu_of_worker).values())
        begun, cpu = time.perf_counter(), time.process_time()
        image = render_on_cluster(SCENE, address, **words)
        seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
        workers = sum(client.run(cpu_of_worker).values()) - before
    return Rendered(seconds, cpu, workers, image.stats["cluster"])


def of_many_parts(address: str, parts: int) -> tuple[float, float]:
    """Return what a picture of so many parts costs the client, and the worker [s of CPU time]."""
    with mock.patch.object(cluster_run, "PARTS_A_WORKER", parts):
        found = render(address, spp=1, size=(512, 512))
    assert found.account["parts"] == parts
    return found.client_cpu, found.workers_cpu


def split_of(title: str, found: Rendered) -> str:
    """Return where the time of a render went, as people read it."""
    steps = ", ".join(f"{name} {value:.2f}" for name, value in found.account["seconds"].items())
    busy = ", ".join(f"{row['seconds']:.1f} s in {row['parts']} parts" for row in found.account["workers"].values())
    cpu = f"{found.workers_cpu:.2f} s of CPU time in workers, {found.client_cpu:.2f} s here"
    return f"{title}: {found.seconds:.1f} s ({steps}); {cpu}; its workers were busy for {busy}"


def measured(long_s: float, pairs: int) -> tuple[Costs, list[float], list[float]]:
    """Return the costs of a part, and of each pair how much faster two workers were, and how much more CPU time took.

    Parameters
    ----------
    long_s
        What one worker is to take, so long that opening and the last parts hardly count [s].
    """
    spp, colds, times, cpus, seconds = 0, [], [], [], []
    for _ in range(pairs):  # one cluster at a time: one that idles has its share of the two cores
        found = []
        for workers in (1, 2):
            with cluster(workers) as address:
                colds.append(render(address, spp=1, size=(64, 64)).seconds)
                spp = spp or max(round(32 * long_s / render(address, spp=32, size=(480, 270)).parts_s), 1)
                found.append(render(address, spp=spp, size=(480, 270)))
        one, two = found
        print(split_of("one worker", one))
        print(split_of("two workers", two))
        times.append(one.seconds / two.seconds)
        cpus.append((two.workers_cpu + two.client_cpu) / one.workers_cpu)
        seconds.append(one.parts_s / one.account["parts"])
    with cluster(1) as address:
        render(address, spp=1, size=(64, 64))
        few, many = (of_many_parts(address, parts) for parts in (16, 128))
    client, beside = (max(last - first, 0.0) / (128 - 16) for first, last in zip(few, many, strict=True))
    spread = statistics.pstdev(seconds) / statistics.mean(seconds) if pairs > 1 else 0.1
    return Costs(client, beside, max(spread, 0.1), statistics.median(colds)), times, cpus


def modelled(work_s: float, workers: int, costs: Costs) -> float:
    """Return the efficiency of a cluster: work of one worker [s] over workers times the time that they take."""
    parts = cluster_run.parts_of(work_s, workers)
    rng = np.random.default_rng(1)
    each = iter(work_s / parts * np.exp(rng.normal(0, costs.spread, parts) - costs.spread**2 / 2) + costs.worker)
    # The end of the part at hand of each worker, and when the client has sent the one after it: they are sent ahead
    ends = [(costs.start + next(each), costs.start) for _ in range(min(workers, parts))]
    heapq.heapify(ends)
    client = 0.0
    while ends:
        end, sent = heapq.heappop(ends)
        client = max(client, end) + costs.client
        seconds = next(each, None)
        if seconds is not None:
            heapq.heappush(ends, (max(end, sent) + seconds, client))
    return work_s / (workers * client)


def main() -> None:
    """Measure, model, and print both tables."""
    parser = arguments("One worker, two workers, and a model of many.")
    parser.add_argument("--seconds", type=float, default=60.0, help="of one worker in each pair (default 60)")
    parser.add_argument("--pairs", type=int, default=3, help="pairs of one and two workers (default 3)")
    options = parser.parse_args()
    facts: dict[str, Any] = machine(choose_device(options.device))
    print_machine(facts)
    costs, ratios, cpus = measured(6.0 if options.quick else options.seconds, 1 if options.quick else options.pairs)
    print(f"load before: {os.getloadavg()[0]:.1f}")
    print(f"two workers over one: {statistics.median(ratios):.2f} ({', '.join(f'{ratio:.2f}' for ratio in ratios)})")
    print(f"CPU time of two workers and client over that of one worker: {statistics.median(cpus):.2f}")
    milliseconds = f"{1e3 * costs.client:.1f} ms at the client, {1e3 * costs.worker:.1f} ms beside its rendering"
    print(f"a part: {milliseconds}; a worker begins after {costs.start:.1f} s")
    rows = [
        [f"{workers}", *(f"{modelled(3600.0 * hours, workers, costs):.0%}" for hours in HOURS)] for workers in WORKERS
    ]
    print_table("Efficiency", ("workers", *(f"{hours} h of one" for hours in HOURS)), rows)
    write_json(options.json, facts, {"ratios": ratios, "cpu": cpus, "costs": vars(costs), "efficiency": rows})


if __name__ == "__main__":
    main()
