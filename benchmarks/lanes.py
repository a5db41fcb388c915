"""How many lanes of a GPU's warps have a path to work on, with slots in place and as the pass ``sort`` orders them.

    python -m benchmarks.lanes [--scenes A A_lens B C materials tea] [--json FILE]

Counted on a processor that works as a GPU does: before each pass its paths are read, and taken 32 at a time in both
orders. A warp in which no lane works leaves at once and does not count. Roulette is played.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.films import EXAMPLES
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import FULL_SIZE, reference_scene
from rptcam_cl.core.records import STATE_FIELDS
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import ORGANISATION, PASSES, Launch, Session
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.layers import PATH_ENDED
from rptcam_cl.rendering.passes import SORTED
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

WARP, SECTOR = 32, 8  # lanes; slots whose field a card reads together, 32 bytes
SEARCHES = ("intersect", "travel")
WIDTH = 160  # of an example [pixels]

Counts = dict[str, NDArray[np.int64]]  # by pass and order: working lanes, their warps, kinds in those, sectors, items


def scene_of(name: str) -> Scene:
    """Return a reference scene at a quarter of its width, or an example at about that size."""
    if name in FULL_SIZE:
        return reference_scene(name, shrink=4, roulette=True)
    scene = load_scene(EXAMPLES / f"{name}.yaml")
    width, height = scene.film.resolution
    return change_scene(scene, film={"resolution": (WIDTH, max(WIDTH * height // width, 1))})


def warps(order: NDArray[np.int64], works: NDArray[np.bool_], kinds: NDArray[np.int64]) -> NDArray[np.int64]:
    """Count working lanes, warps with any, kinds of material in those, and sectors that they read of a field."""
    order = np.pad(order, (0, -len(order) % WARP), constant_values=-1).reshape(-1, WARP)
    works = (order >= 0) & works[order]
    some = works.any(axis=1)
    distinct = [(len(set(kinds[row])), len(set(row // SECTOR))) for row in map(np.compress, works[some], order[some])]
    return np.array([works.sum(), some.sum(), *np.sum(distinct, axis=0, dtype=int)] if distinct else [0] * 4)


class Counting:
    """Counts before each pass of a wavefront, which it takes through the first wave of its film."""

    def __init__(self, session: Session, scene: Scene, samples: int = 4) -> None:
        self._session, self._plan = session, make_plan(scene)
        self._wavefront = Wavefront(session, self._plan, FilmLayout.of(scene.film), scene.render)
        self._kinds = self._plan.materials["kind"][self._plan.primitives["material"]].astype(int)
        self.counts: Counts = defaultdict(lambda: np.zeros(5, int))
        self._depth, self._living = 0, np.array([], bool)
        launches = self._wavefront._launches
        self._run, launches.run = launches.run, self._counted  # type: ignore[method-assign]
        for wave in self._wavefront.waves(0, min(samples, self._wavefront.samples_per_wave)):
            self._wavefront.enqueue(*wave)
        self._wavefront.finish()

    def _fields(self) -> dict[str, NDArray[np.float32]]:
        held = self._wavefront._held
        capacity = held.capacity
        state = self._session.read(held.state, np.float32, self._wavefront.needs.paths // 4)
        return dict(zip(STATE_FIELDS, state.reshape(-1, capacity), strict=False))

    def _orders(self, fields: dict[str, NDArray[np.float32]], items: int) -> Iterator[tuple[str, NDArray[np.int64]]]:
        yield "in place", np.arange(items)
        queue = fields["QUEUE"].view(np.uint16).astype(int)
        capacity = len(fields["QUEUE"])
        rows = []
        for block in range(-(-items // SORTED)):
            first = block * SORTED
            row = first + queue[first : first + queue[capacity + block]]
            rows.append(np.pad(row, (0, -len(row) % WARP), constant_values=-1))
        yield "sorted", np.concatenate(rows)

    def _counted(self, launch: Launch, items: int) -> None:
        self._depth = self._depth + 1 if launch.name in SEARCHES else 0 if launch.name == "film" else self._depth
        if launch.name in (*SEARCHES, "shade", "shadow"):
            fields = self._fields()
            hit = fields["HIT"].view(np.int32)
            orders = dict(self._orders(fields, items))
            if launch.name in SEARCHES:
                if self._depth == 1:  # when nothing is sorted yet
                    orders["sorted"] = orders["in place"]
                self._living = fields["ORIGIN"].view(np.int32) != PATH_ENDED
                self._living[np.setdiff1d(orders["in place"], orders["sorted"])] = False  # which met nothing
            works = fields["REACH"] > 0 if launch.name == "shadow" else self._living
            kinds = np.where(hit >= 0, self._kinds[np.maximum(hit, 0)], hit)
            for name, order in orders.items():
                self.counts[f"{launch.name}, {name}"] += [*warps(order, works, kinds), items]
        self._run(launch, items)


def main() -> None:
    """Count all scenes and print the table."""
    parser = arguments("Count the lanes of warps that have a path to work on.")
    parser.add_argument("--scenes", nargs="+", default=["A", "A_lens", "B", "C", "materials", "tea"], metavar="NAME")
    options = parser.parse_args()
    os.environ[ORGANISATION] = PASSES
    session = Session(choose_device(options.device))
    rows, results = [], dict[str, Any]()
    for name in options.scenes:
        counts = Counting(session, scene_of(name)).counts
        results[name] = {key: found.tolist() for key, found in counts.items()}
        for key, (lanes, of_warps, kinds, sectors, items) in counts.items():
            share, mixed, read = lanes / of_warps / WARP, kinds / of_warps, sectors / lanes
            launched = f"{items / lanes:.2f}"
            rows.append([name, key, f"{share:.2f}", f"{of_warps}", f"{mixed:.2f}", f"{read:.2f}", launched])
    facts = machine(session.info)
    print_machine(facts)
    columns = ("scene", "pass", "lanes that work", "warps", "kinds of material", "sectors a lane", "items a lane")
    print_table("Lanes of a GPU's warps, first four samples", columns, rows)
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
