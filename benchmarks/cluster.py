"""What a cluster gains: two workers beside one on this machine, what a part costs beside its rendering, 1000 workers.

    python -m benchmarks.cluster [--json FILE]

Each worker has one core. The costs are measured here; larger clusters are a discrete model with these costs: workers
take parts as they become free, the client takes parts in one after the other, and a picture ends with its last part.
"""

from __future__ import annotations

import heapq
import os
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
from rptcam_cl import render_on_cluster
from rptcam_cl.cluster import run
from rptcam_cl.device import choose_device

SCENE = Path(__file__).resolve().parents[1] / "examples" / "first_light.yaml"
WORKERS = (1, 10, 30, 100, 300, 1000)
HOURS = (1, 10, 100)  # of one worker


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """A scheduler with workers of one core each."""
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address="127.0.0.1:0",
        memory_limit=0, silence_logs=50, env={"POCL_MAX_PTHREAD_COUNT": "1", "POCL_CPU_MAX_CU_COUNT": "1"},
    ) as found:  # fmt: skip
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


def render(address: str, **words: Any) -> tuple[float, float, dict[str, Any]]:
    """Render on a cluster; return the time that it took, the CPU time of this process, and its account."""
    begun, cpu = time.perf_counter(), time.process_time()
    image = render_on_cluster(SCENE, address, **words)
    return time.perf_counter() - begun, time.process_time() - cpu, image.stats["cluster"]


def of_many_parts(address: str, parts: int) -> tuple[float, float]:
    """Return what a picture of so many parts costs the client [s of CPU time], and how long it takes [s]."""
    with mock.patch.object(run, "PARTS_A_WORKER", parts):
        seconds, cpu, account = render(address, spp=1, size=(512, 512))
    assert account["parts"] == parts
    return cpu, seconds


def measured(spp: int, pairs: int) -> tuple[Costs, list[float]]:
    """Return the costs of a part, and how much faster two workers were than one, in each pair."""
    with cluster(1) as one, cluster(2) as two:
        cold, _, _ = render(one, spp=1, size=(64, 64))
        render(two, spp=1, size=(64, 64))
        ratios, seconds = [], []
        for _ in range(pairs):
            alone, _, account = render(one, spp=spp, size=(480, 270))
            both, _, _ = render(two, spp=spp, size=(480, 270))
            ratios.append(alone / both)
            row = next(iter(account["workers"].values()))
            seconds.append(row["seconds"] / account["parts"])
        few, many = (of_many_parts(one, parts) for parts in (16, 128))
    client, beside = (max(last - first, 0.0) / (128 - 16) for first, last in zip(few, many, strict=True))
    spread = statistics.pstdev(seconds) / statistics.mean(seconds) if pairs > 1 else 0.1
    return Costs(client, max(beside - client, 0.0), max(spread, 0.1), cold), ratios


def modelled(work_s: float, workers: int, costs: Costs) -> float:
    """Return the efficiency of a cluster: work of one worker [s] over workers times the time that they take."""
    parts = run.parts_of(work_s, workers)
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
    parser.add_argument("--spp", type=int, default=1024, help="samples per pixel of the pairs (default 1024)")
    parser.add_argument("--pairs", type=int, default=3, help="pairs of one and two workers (default 3)")
    options = parser.parse_args()
    facts: dict[str, Any] = machine(choose_device(options.device))
    print_machine(facts)
    costs, ratios = measured(64 if options.quick else options.spp, 1 if options.quick else options.pairs)
    print(f"load before: {os.getloadavg()[0]:.1f}")
    print(f"two workers over one: {statistics.median(ratios):.2f} ({', '.join(f'{ratio:.2f}' for ratio in ratios)})")
    milliseconds = f"{1e3 * costs.client:.1f} ms at the client, {1e3 * costs.worker:.1f} ms beside its rendering"
    print(f"a part: {milliseconds}; a worker begins after {costs.start:.1f} s")
    rows = [
        [f"{workers}", *(f"{modelled(3600.0 * hours, workers, costs):.0%}" for hours in HOURS)] for workers in WORKERS
    ]
    print_table("Efficiency", ("workers", *(f"{hours} h of one" for hours in HOURS)), rows)
    write_json(options.json, facts, {"ratios": ratios, "costs": vars(costs), "efficiency": rows})


if __name__ == "__main__":
    main()
