"""Polynomials in place of the surfaces of a lens: what a camera ray costs both ways, and what the polynomials err by.

    python -m benchmarks.ray_maps [--seconds 0.2] [--json FILE]

The scene is an empty world under an even sky, so that most of a sample is its camera ray; the time of the camera's
kernel is its share of the CPU time by OpenCL's profiling events (on a GPU, of the device's time). Both ways take turns.
The last columns are of a whole picture of scene A, three spheres.
"""

from __future__ import annotations

import itertools
from typing import Any

from benchmarks.passes import measure
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import reference_scene, wavefront_of
from benchmarks.stopwatch import fastest
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import forget
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.lens_records import disperses
from rptcam_cl.scene.changes import change_scene, with_camera
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

LENSES: tuple[tuple[str, dict[str, Any], float], ...] = (  # with what is set of it, and the width of the film [mm]
    ("achromat-100mm", {"f_number": 8}, 24.0),
    ("biconvex-stop", {}, 12.0),
    ("cooke-triplet-50mm", {}, 36.0),
    ("dgauss-50mm", {}, 36.0),
    ("dgauss-50mm", {"f_number": 4}, 36.0),
    ("fisheye-10mm", {}, 20.0),
    ("wide-22mm", {}, 36.0),
    ("retrofocus-28mm", {}, 36.0),
    ("double-gauss-50mm-f1.1", {}, 36.0),
    ("zoom-80-200mm", {}, 36.0),
    ("zoom-70-200mm", {}, 36.0),
    ("phone-5.6mm", {}, 5.0),
)
PIXELS = 1920  # across the film, for which errors are told
ROUNDS = 3
WAYS = ("traced", "fitted")
COLUMNS = (
    "lens", "surfaces", "f/", "colour", "degree", "rims", "largest error", "light", "fit",
    "traced: ns per ray", "fitted", "gain", "picture: ns per sample", "fitted", "gain",
)  # fmt: skip


def camera(lens: str, keys: dict[str, Any]) -> dict[str, Any]:
    """Return a camera that looks at the origin from two metres."""
    return {
        "kind": "realistic",
        "lens": lens,
        "eye": [0, 0, 2],
        "target": [0, 0, 0],
        "focus": {"distance_m": 2},
        **keys,
    }


def empty_world(lens: str, keys: dict[str, Any], width_mm: float, pixels: int, colour: str) -> Scene:
    """Return a scene of nothing but an even sky."""
    return load_scene(
        {
            "film": {"resolution": [pixels, pixels * 2 // 3], "width_mm": width_mm},
            "camera": camera(lens, keys),
            "environment": {"kind": "constant", "radiance": 1},
            "render": {"sampler": "independent"},
            "spectrum": {"mode": "dispersive", "lens": "on"} if colour == "dispersive" else {"mode": "rgb"},
        }
    )


def spheres(lens: str, keys: dict[str, Any], width_mm: float, shrink: int, colour: str) -> Scene:
    """Return scene A through a lens."""
    scene = reference_scene("A_lens", shrink=shrink)
    pose = {name: getattr(scene.camera, name) for name in ("eye", "target", "up")}
    scene = with_camera(scene, {"kind": "realistic", "lens": lens, **pose, "focus": {"distance_m": 2}, **keys})
    spectrum = {"mode": "dispersive", "lens": "on"} if colour == "dispersive" else {"mode": "rgb"}
    columns, rows = scene.film.resolution
    return change_scene(scene, film={"size_mm": [width_mm, width_mm * rows / columns]}, spectrum=spectrum)


def compared(scene: Scene, session: Session, seconds: float, rounds: int) -> dict[str, dict[str, float]]:
    """Return, for both ways, what a camera ray and a sample cost [ns]: the least of several turns."""
    wavefronts = {way: wavefront_of(change_scene(scene, camera={"rays": way}), session, None, "passes") for way in WAYS}
    best: dict[str, dict[str, float]] = {way: {} for way in WAYS}
    for _, way in itertools.product(range(rounds), WAYS):
        found = measure(wavefronts[way], seconds)
        seen = {"ray": found["ns_per_sample"] * found["shares"]["generate"], "sample": found["ns_per_sample"]}
        best[way] = {name: min(value, best[way].get(name, value)) for name, value in seen.items()}
    return best


def row(
    session: Session, lens: str, keys: dict[str, Any], width_mm: float, colour: str, options: Any
) -> dict[str, Any]:
    """Return everything about one lens."""
    pixels, shrink, seconds, rounds = (48, 16, 0.01, 1) if options.quick else (480, 2, options.seconds, ROUNDS)
    surfaces = load_lens(lens).surfaces
    told: dict[str, Any] = {"lens": lens, "surfaces": len(surfaces), "colour": colour}
    full = change_scene(empty_world(lens, keys, width_mm, PIXELS, colour), camera={"rays": "fitted"})
    mode = "on" if colour == "dispersive" else "off"

    def fit() -> None:
        forget()
        told.update(camera_model(full, mode).metadata)

    camera_model(change_scene(full, camera={"rays": "traced"}), mode)  # finds the pupil, which both need
    try:
        told["fit_seconds"] = fastest(fit, 1).cpu
    except InputError as problem:
        return told | {"refused": str(problem)}
    told["rays"] = compared(empty_world(lens, keys, width_mm, pixels, colour), session, seconds, rounds)
    told["picture"] = compared(spheres(lens, keys, width_mm, shrink, colour), session, seconds, rounds)
    return told


def cells(found: dict[str, Any]) -> list[str]:
    """Return a row of the table."""
    head = [found["lens"], str(found["surfaces"])]
    if "refused" in found:
        return [*head, "", found["colour"], f"- ({found['refused'].rpartition(': ')[2]})", *[""] * (len(COLUMNS) - 5)]
    ray, sample = (
        {way: found[what][way][name] for way in WAYS} for what, name in (("rays", "ray"), ("picture", "sample"))
    )
    return [
        *head,
        f"{found['f_number']:.1f}",
        found["colour"],
        str(found["lens_degree"]),
        str(found["lens_rims"]),
        f"{found['lens_error_px']:.2f} px",
        f"{100 * found['lens_light_error']:.2f} %",
        f"{found['fit_seconds']:.2f} s",
        *(f"{ray[way]:.1f}" for way in WAYS),
        f"{ray['traced'] / ray['fitted']:.2f}",
        *(f"{sample[way]:.1f}" for way in WAYS),
        f"{sample['traced'] / sample['fitted']:.2f}",
    ]


def main() -> None:
    """Measure and print the table."""
    parser = arguments("Polynomials in place of the surfaces of a lens.")
    parser.add_argument("--seconds", type=float, default=0.2, help="length of a render (default 0.2)")
    options = parser.parse_args()
    session = Session(choose_device(options.device), profiling=True)
    facts = machine(session.info)
    results = [
        row(session, *each, colour, options)
        for each in (LENSES[3:4] if options.quick else LENSES)
        for colour in (("one wavelength", "dispersive") if disperses(load_lens(each[0])) else ("one wavelength",))
    ]
    print_machine(facts)
    print_table(f"Camera rays, errors for {PIXELS} pixels across", COLUMNS, [cells(found) for found in results])
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
