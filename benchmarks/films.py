"""A fingerprint of the film of every example and reference scene: what a change that must change no bit is held to.

    python -m benchmarks.films --json before.json
    python -m benchmarks.films --json after.json
    python -m benchmarks.films --compare before.json after.json

Each scene is rendered small, in both organisations of the work, with its caustics, its motion and its layers. Bits hold
for one processor and one driver, so that the fingerprints are not kept in the repository.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import FULL_SIZE, reference_scene, render_samples, wavefront_of
from rptcam_cl.core.errors import RptcamError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
ORGANISATIONS = ("stream", "passes")
SIZE, SPP = (48, 32), 4


def films(session: Session, scene: Scene) -> dict[str, str]:
    """Return the first 16 digits of the film's sha256, by organisation."""
    found = {}
    for organisation in ORGANISATIONS:
        wavefront = wavefront_of(scene, session, organisation=organisation)
        render_samples(wavefront, SPP)
        found[organisation] = hashlib.sha256(wavefront.sums().tobytes() + wavefront.planes().tobytes()).hexdigest()[:16]
    return found


def scenes() -> dict[str, Scene]:
    """Return the scenes at the size of a fingerprint, by name."""
    found = {name: reference_scene(name) for name in FULL_SIZE}
    found |= {path.stem: load_scene(path) for path in sorted(EXAMPLES.glob("*.yaml"))}
    return {name: change_scene(scene, film={"resolution": SIZE}) for name, scene in found.items()}


def compare(before: Path, after: Path) -> int:
    """Print the scenes whose films differ in two files, and return their number."""
    first, second = (json.loads(path.read_text(encoding="utf-8"))["results"] for path in (before, after))
    changed = sorted(name for name in first.keys() | second.keys() if first.get(name) != second.get(name))
    print(f"{len(first)} scenes; films that differ: {', '.join(changed) or 'none'}")
    return len(changed)


def main() -> int:
    """Run the command line."""
    parser = arguments("Take fingerprints of the films of all example and reference scenes.")
    parser.add_argument("--compare", nargs=2, type=Path, metavar="FILE", help="compare two files, and render nothing")
    options = parser.parse_args()
    if options.compare:
        return min(compare(*options.compare), 1)
    device = choose_device(options.device)
    facts = machine(device)
    print_machine(facts)
    results: dict[str, Any] = {}
    for name, scene in scenes().items():
        try:
            results[name] = films(Session(device), scene)
        except RptcamError as error:
            results[name] = {organisation: str(error) for organisation in ORGANISATIONS}
    rows = [[name, *found.values()] for name, found in results.items()]
    print_table(f"Films of {SIZE[0]} x {SIZE[1]} pixels, {SPP} spp", ["scene", *ORGANISATIONS], rows)
    write_json(options.json, facts, results)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
