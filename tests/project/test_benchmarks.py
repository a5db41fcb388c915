"""Every benchmark runs: its quick mode ends well, prints its tables and writes its numbers."""

import importlib
import importlib.util
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from benchmarks import cycles_scene, hard_light
from benchmarks.equal_time import exact_count
from benchmarks.even_noise import Way, tile_errors
from benchmarks.mitsuba_lens import prescription
from benchmarks.mitsuba_scene import describe
from benchmarks.mitsuba_worker import find_llvm
from benchmarks.scenes import reference_scene
from benchmarks.worker import Worker, WorkerError
from rptcam_cl.api.job import render
from rptcam_cl.device.devices import choose_device
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.traceable_lens import load_lens
from rptcam_cl.scene.load import load_scene
from tests.support.browsing import needs_chromium

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


def quick(checkout: Path, folder: Path, name: str, *options: str) -> tuple[str, Any]:
    """Run the quick mode of a benchmark; return what it printed and the results in its file."""
    numbers = folder / "numbers.json"
    command = [sys.executable, "-m", f"benchmarks.{name}", "--quick", "--json", str(numbers), *options]
    done = subprocess.run(command, cwd=checkout, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    written = json.loads(numbers.read_text("utf-8"))
    assert "load_average" in written["machine"]
    return done.stdout, written["results"]


def test_benchmarks_find_all_that_they_use() -> None:
    """Quick even for those whose runs are slow tests: what they import is there."""
    for path in sorted(FOLDER.glob("*.py")):
        assert importlib.import_module(f"benchmarks.{path.stem}").__doc__, path


def test_numbers_of_samples_are_those_that_a_sampler_takes_as_they_are() -> None:
    assert exact_count(37, 16, lambda count: 35 if count == 32 else count) == 48  # 32 becomes 35, no multiple of 16
    assert exact_count(90, 16, lambda count: 4 ** math.ceil(math.log(count, 4))) == 64
    assert exact_count(3, 16, lambda count: count) == 16
    with pytest.raises(WorkerError, match="no multiple of 16"):
        exact_count(40, 16, lambda count: count + 1)


def test_the_lens_scene_is_measured_with_the_pupil_that_users_get() -> None:
    assert reference_scene("A_lens", shrink=8).camera.pupil == "auto"


@pytest.mark.slow
def test_caustics_have_an_error_by_both_ways(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "caustics", "--scenes", "mirror", "--pictures", str(tmp_path))
    assert "| mirror |" in printed
    assert results["mirror"]["error on"] < results["mirror"]["error off"]
    assert (tmp_path / "caustics_mirror.png").exists()


@pytest.mark.slow
def test_caustics_of_a_file_are_saved_at_the_shape_of_its_film(checkout: Path, tmp_path: Path) -> None:
    scene = tmp_path / "wide.yaml"
    lamp = {"shape": "sphere", "center": [0, 2, 0], "radius": 0.1, "material": {"kind": "emissive", "radiance": 9}}
    floor = {
        "shape": "plane",
        "point": [0, 0, 0],
        "normal": [0, 1, 0],
        "material": {"kind": "matte", "reflectance": 0.5},
    }
    camera = {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 1, 4], "target": [0, 0, 0]}
    scene.write_text(json.dumps({"film": {"resolution": [24, 8]}, "camera": camera, "objects": [floor, lamp]}))
    printed, _ = quick(checkout, tmp_path, "caustics", "--scenes", str(scene), "--pictures", str(tmp_path))
    assert "wide.yaml |" in printed
    with Image.open(tmp_path / "caustics_wide.png") as picture:
        assert picture.size == (24 + 6 + 24, 8)


@pytest.mark.slow
def test_shares_of_the_passes_sum_to_one(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "passes")
    assert "| A_lens |" in printed
    assert {found["organisation"] for found in results["passes"]} == {"stream", "passes"}
    for found in results["passes"]:
        assert sum(found["shares"].values()) == pytest.approx(1)
    assert all(0 < found["passed"] <= 1 for found in results["pupils"].values())


@pytest.mark.slow
def test_motion_is_compared_with_the_scene_standing_still(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "motion_costs")
    assert printed.count("camera moves") == len(results) == 3
    assert all(found["still"] == [1.0] and len(found) == 5 for found in results.values())


@pytest.mark.slow
def test_edits_are_timed_in_both_scenes(checkout: Path, tmp_path: Path) -> None:
    _, results = quick(checkout, tmp_path, "edits")
    assert len(results) == 9 and all(set(found) == {"change", "glance", "sample"} for found in results.values())


@pytest.mark.slow
def test_growth_has_its_four_tables(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "growth")
    assert printed.count("Msamples/s by wall") == len(results) == 4
    assert list(results["spheres"]) == ["10", "32"]


@pytest.mark.slow
def test_advice_is_told_beside_what_came_of_it(checkout: Path, tmp_path: Path) -> None:
    page = tmp_path / "table.md"
    printed, results = quick(checkout, tmp_path, "advice", "landscape", "--markdown", str(page))
    assert page.read_text("utf-8").strip() in printed
    assert [found["advice"]["wish"] for found in results["verdicts"]] == ["time", "error"]
    assert all(found["obtained"]["uncertainty"] > 0 and found["verdict"] for found in results["verdicts"])
    first = results["said"]["landscape"][0]
    assert first.startswith("Set: in 200 ms rptcam render SCENE --set ") and "  " not in first


@pytest.mark.slow
def test_advised_configurations_are_counted(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "advised")
    assert set(results["first_light"].values()) <= {"compared", "chosen", "may be better"}
    assert "chosen" in results["first_light"].values()
    assert "| independent samples |" in printed


@pytest.mark.slow
def test_ways_to_aim_at_the_pupil_are_compared(checkout: Path, tmp_path: Path) -> None:
    printed, _ = quick(checkout, tmp_path, "pupil_tiers")
    assert "tight" in printed


@pytest.mark.slow
def test_samplers_are_compared_on_every_scene(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "samplers", "--seeds", "3")
    assert "soft shadow" in printed
    assert len(results) == 10
    assert all(variance > 0 for found in results for variance, _ in found["by_spp"].values())


@pytest.mark.slow
def test_modes_of_the_spectrum_are_compared(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "spectra")
    assert "dispersive (compiled as rgb)" in printed
    for found in results.values():
        assert list(found) == ["rgb", "dispersive", "spectral"]
        assert all(mode["ns_per_sample"] > 0 and mode["colour_noise"] > 0 for mode in found.values())
    assert results["a lens that disperses"]["dispersive"]["light"] == "dispersive"


@pytest.mark.slow
def test_noise_behind_every_shape_of_aperture_is_measured(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "apertures", "--seeds", "3")
    assert "mask" in printed
    assert all(found["camera_ns_per_sample"] > 0 for found in results if "sampler" not in found)
    assert all(noise > 0 for found in results if "sampler" in found for noise in found["noise"].values())


@pytest.mark.slow
def test_device_compared_with_itself_makes_the_same_bits(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "devices", "--reference", choose_device().id)
    assert printed.count("same bits") == len(results["scenes"]) == 4
    assert all(found["other_bits"] == 0 and found["speed"] > 0.2 for found in results["scenes"].values())
    assert results["numerics"]["passed"] == results["numerics"]["made"] >= 20
    assert results["numerics"]["failed"] == []


@pytest.mark.slow
def test_start_is_measured_cold_warm_and_by_a_process_that_stays(checkout: Path, tmp_path: Path) -> None:
    _, results = quick(checkout, tmp_path, "startup")
    assert results["cold"][0]["cpu"] > results["warm"][0]["cpu"] > 0
    assert len(results["resident"]) == (sys.platform == "linux")


@pytest.mark.slow
def test_rays_are_measured_beside_numpy_and_the_peak(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "lens_rays")
    assert "GFLOP/s" in printed
    assert results["tracers"]["kernel, float32"]["wall"] > 0


def test_another_lens_program_that_is_missing_is_named() -> None:
    with pytest.raises(WorkerError, match="no-such-program cannot be imported"):
        Worker(sys.executable, "benchmarks.optics_worker", "no-such-program")


@pytest.mark.slow
def test_setup_of_frames_is_measured_beside_their_rays(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "dataset_setup")
    assert "| dataset |" in printed
    assert all(min(times.values()) > 0 for times in results["dataset"].values())


@pytest.mark.slow
def test_pupil_tables_are_timed_for_every_lens(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "pupil_tables")
    assert len(results) == 3 and "achromat-100mm" in printed
    assert all(found["tight"] > 0.6 and found["again"] < found["seconds"] for found in results.values())


@pytest.mark.slow
def test_surfaces_of_every_kind_are_compared_with_a_sphere(checkout: Path, tmp_path: Path) -> None:
    _, results = quick(checkout, tmp_path, "surface_costs")
    assert results["spheres"]["sphere"] == 1 and results["spheres"]["toroid"] > 1


@pytest.mark.slow
def test_losses_in_a_lens_are_compared_with_none(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "loss_costs")
    assert "single layers, absorption" in printed
    assert all(time > 0 for times in results["seconds_per_ray"].values() for time in times)


@pytest.mark.slow
def test_building_trees_is_timed_by_stage(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "bvh_build")
    assert "wide nodes" in printed
    for found in results:
        assert found["seconds"]["all"]["wall"] > 0
        assert found["quality"]["fill"] > 0.7


@pytest.mark.slow
def test_rays_at_meshes_agree_with_those_of_others(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "mesh_rays")
    assert [found["rays"] for found in results] == ["primary", "diffuse bounce", "the same, shuffled", "shadow"]
    assert "| shadow " in printed
    for found in results:
        assert 0.1 < found["hit"] < 0.9
        assert min(found["agreement"].values()) > 0.99


@pytest.mark.slow
def test_mesh_files_are_read_beside_trimesh(checkout: Path, tmp_path: Path) -> None:
    _, results = quick(checkout, tmp_path, "mesh_files")
    assert len(results["reading"]) == 4
    assert all(found["cpu"] > 0 for pair in results["reading"].values() for found in pair.values())
    ours = [counts for name, counts in results["damaged"].items() if name.endswith("rptcam")]
    assert [list(counts) for counts in ours] == [["refused"], ["refused"]]


@pytest.mark.slow
def test_memory_of_meshes_is_told(checkout: Path, tmp_path: Path) -> None:
    _, results = quick(checkout, tmp_path, "mesh_memory")
    assert 40 < results["bytes_per_triangle"]["all"] < 200
    assert 0.05 < results["large"]["built"]["gigabytes"] < 2


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba (extra `bench`) is not installed")
@pytest.mark.skipif(find_llvm() is None, reason="no LLVM library for mitsuba's llvm variants")
def test_noise_is_compared_at_equal_time(checkout: Path, tmp_path: Path) -> None:
    _, results = quick(checkout, tmp_path, "equal_time", "--scenes", "A_lens", "B")
    assert [found["renderer"] for found in results] == (["ours"] * 2 + ["Mitsuba"] * 3) * 2
    for found in results:
        assert found["relmse"] == pytest.approx(found["noise"], rel=0.5)  # no bias


def test_time_to_a_noise_lies_between_two_pictures_and_beyond_the_last_one() -> None:
    way = Way("ours", "even samples", made=[(1.0, (0.4, 0.4)), (4.0, (0.1, 0.2)), (16.0, (0.025, 0.1))])
    assert way.reached(0) == (pytest.approx(8.0), True)  # halfway between 4 and 16 in logarithms, as 0.05 is
    assert way.reached(1) == (pytest.approx(64.0), False)
    way.ended = True  # no more samples are made
    assert way.reached(0) == (pytest.approx(8.0), True)
    assert way.reached(1) == (math.inf, False)


def test_errors_of_tiles_are_those_of_the_noise_and_not_of_the_reference() -> None:
    rng = np.random.default_rng(1)
    truth = np.full((64, 96, 3), 2.0)
    truth[:, 48:] = 0.01  # darker than a twentieth of the mean, 1.005
    noise = 0.05 * np.repeat(rng.standard_normal((3, 64, 96, 1)), 3, axis=3)
    found = tile_errors(truth + 0.8 * noise[0], (truth + noise[1], truth + noise[2]))
    assert found.shape == (8, 12)
    assert np.sqrt((found[:, :6] ** 2).mean()) == pytest.approx(0.04 / 2, rel=0.1)
    assert np.sqrt((found[:, 6:] ** 2).mean()) == pytest.approx(0.04 / (0.05 * 1.005), rel=0.1)


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba (extra `bench`) is not installed")
@pytest.mark.skipif(find_llvm() is None, reason="no LLVM library for mitsuba's llvm variants")
def test_seconds_to_a_noise_are_told_for_every_way(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "even_noise", "--scenes", "A")
    assert "| Mitsuba  |" in printed
    assert [found["renderer"] for found in results] == ["ours"] * 2 + ["Mitsuba"] * 2


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba (extra `bench`) is not installed")
@pytest.mark.skipif(find_llvm() is None, reason="no LLVM library for mitsuba's llvm variants")
def test_both_renderers_do_the_same_work(checkout: Path, tmp_path: Path) -> None:
    _, results = quick(checkout, tmp_path, "against_mitsuba", "--scenes", "A_thin", "D")
    assert [(found["scene"], found["roulette"]) for found in results] == [
        ("A_thin", False),
        ("A_thin", True),
        ("D", False),
        ("D", True),
    ]


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba (extra `bench`) is not installed")
@pytest.mark.skipif(find_llvm() is None, reason="no LLVM library for mitsuba's llvm variants")
def test_features_look_alike_in_both_renderers(checkout: Path, tmp_path: Path) -> None:
    _, results = quick(checkout, tmp_path, "mitsuba_features")
    for found in results:
        assert abs(found["differs"]) < 0.003 + 4 * found["error"], found["feature"]


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba (extra `bench`) is not installed")
@pytest.mark.skipif(find_llvm() is None, reason="no LLVM library for mitsuba's llvm variants")
def test_caustics_look_alike_in_both_renderers(checkout: Path, tmp_path: Path) -> None:
    _, results = quick(checkout, tmp_path, "mitsuba_photons")
    for found in results:
        assert abs(found["differs"]) < 0.003 + 4 * found["error"], found["scene"]


@pytest.mark.slow
def test_lens_for_mitsuba_aims_at_all_that_passes() -> None:
    found, lens = prescription(reference_scene("A_lens")), load_lens("dgauss-50mm")
    rng, count = np.random.default_rng(1), 4000
    radius, film_z = rng.uniform(0, found["most"], count), lens.length + found["film_distance"]
    aims = np.stack([*rng.uniform(-20, 20, (2, count)), np.full(count, lens.length - found["pupil_height"])], axis=1)
    starts = np.stack([radius, np.zeros(count), np.full(count, film_z)], axis=1)
    ways = aims - starts
    passed = lens.trace(starts, ways / np.linalg.norm(ways, axis=1, keepdims=True)).passed
    distances = np.linspace(0, found["most"], len(found["circles"]))
    centre, reach = (np.interp(radius, distances, column) for column in np.transpose(found["circles"]))
    inside = np.hypot(aims[:, 0] - centre, aims[:, 1]) <= reach
    assert passed.sum() > 500
    assert inside[passed].all()
    assert passed[inside].mean() > 0.6


def test_worker_that_cannot_start_says_why(tmp_path: Path) -> None:
    with pytest.raises(WorkerError, match="cannot be started"):
        Worker(str(tmp_path / "python"), "benchmarks.mitsuba_worker")


@pytest.mark.skipif(os.name == "nt", reason="a shell script stands in for the worker")
def test_llvm_that_ends_the_worker_is_named(tmp_path):
    fake = tmp_path / "python"
    fake.write_text('#!/bin/sh\necho \'{"description": "Mitsuba 3 llvm_ad_rgb"}\'\nread line\nkill -ABRT $$\n', "utf-8")
    fake.chmod(0o755)
    worker = Worker(str(fake), "benchmarks.mitsuba_worker")
    for _ in range(2):
        with pytest.raises(WorkerError, match=r"llvm_ad_rgb was ended by SIGABRT; .*DRJIT_LIBLLVM_PATH"):
            worker.ask(do="render")


def test_missing_mitsuba_is_answered_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "mitsuba.py").write_text("raise ImportError('not here')\n", "utf-8")
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH="{tmp_path}" exec "{sys.executable}" "$@"\n', "utf-8")
    python.chmod(0o755)
    with pytest.raises(WorkerError, match=r"not here.*rptcam_cl\[bench\]"):
        Worker(str(python), "benchmarks.mitsuba_worker")


def test_description_of_the_cornell_box_has_every_face(tmp_path: Path) -> None:
    description = describe(reference_scene("B"), roulette=False, folder=tmp_path)
    meshes = [item for item in description.values() if isinstance(item, dict) and item.get("type") == "ply"]
    faces = sum(Path(mesh["filename"]).read_text("ascii").count("\n3 ") for mesh in meshes)
    assert faces == 2 * (8 + 2 * 6)  # eight reflecting rectangles and two boxes, two triangles a face
    assert sum("emitter" in item for item in description.values() if isinstance(item, dict)) == 1


@pytest.mark.slow
def test_room_of_meshes_is_told_to_other_renderers_as_it_is(tmp_path: Path) -> None:
    scene = reference_scene("D", shrink=8)
    theirs = describe(scene, roulette=False, folder=tmp_path)
    shapes = [item for item in theirs.values() if isinstance(item, dict) and "bsdf" in item]
    assert sum("emitter" in item for item in shapes) == 2
    ours = make_plan(scene)
    assert sum(faces_of(Path(item["filename"])) for item in shapes if item["type"] == "ply") == 2 * (8 + 6 * 6) + len(
        ours.meshes.triangles
    )
    # Mitsuba's picture has its middle along +z of its own frame: ours along -z, turned by 90 degrees about +y.
    place = np.array(theirs["environment"]["to_world"]["matrix"])[:3, :3]
    assert place @ [0, 0, 1] == pytest.approx([-1, 0, 0])
    assert place @ [0, 1, 0] == pytest.approx([0, 1, 0])
    assert np.linalg.det(place) == pytest.approx(1)
    cycles = cycles_scene.describe(scene, roulette=False, folder=tmp_path)["environment"]
    assert cycles["axes"][2] == pytest.approx([-1, 0, 0])


def faces_of(path: Path) -> int:
    """Return how many faces a PLY file announces."""
    head = path.read_bytes().split(b"end_header")[0]
    return int(re.search(rb"element face (\d+)", head)[1])


@pytest.mark.slow
def test_description_for_cycles_has_every_face_and_the_lens(tmp_path: Path) -> None:
    box = cycles_scene.describe(reference_scene("B"), roulette=False, folder=tmp_path)
    files = {mesh["look"]["kind"]: [] for mesh in box["meshes"]}
    for mesh in box["meshes"]:
        files[mesh["look"]["kind"]].append(np.load(mesh["file"])["faces"])
    assert sum(map(len, files["matte"])) == 8 + 2 * 6 + 1  # the back of the lamp
    assert [lamp["size"] for lamp in box["lamps"]] == [pytest.approx([0.47, 0.38])]
    assert box["camera"]["fov_degrees"] == 39.3
    spheres = cycles_scene.describe(reference_scene("A_lens"), roulette=True, folder=tmp_path)
    assert "#define COUNT 11" in Path(spheres["camera"]["shader"]).read_text("utf-8")
    balls = [np.load(mesh["file"]) for mesh in spheres["meshes"] if mesh["smooth"]]
    assert len(balls) == 3
    for ball in balls:
        points = ball["points"].astype(np.float64)
        middles = points[ball["faces"]].mean(axis=1) - points.mean(axis=0)
        assert np.linalg.norm(middles, axis=1).min() > 1 - 7.2e-5


def test_lamps_for_cycles_shine_where_ours_do(tmp_path: Path) -> None:
    metal = {"kind": "conductor", "reflectance": [0.9, 0.8, 0.7], "alpha": 0.1}
    bulb = hard_light.ball([1, 2, 3], 0.05, hard_light.emissive(9, 18, 27))
    glass = hard_light.ball([1, 2, 3], 0.2, {"kind": "dielectric", "index": 1.5})
    panel = hard_light.rectangle([0, 4, 0], [0.5, 0, 0], [0, 0, 0.25], hard_light.emissive(1, 2, 3))  # downwards
    camera = hard_light.picture_of_light()["camera"]
    sun = {"kind": "directional", "direction": [1.0, -0.6, -0.15], "irradiance": [40.0, 36.0, 30.0]}
    keys = hard_light.scene([bulb, glass, panel, hard_light.ball([0, 0, 0], 1, metal)], camera=camera, lights=[sun])
    found = cycles_scene.describe(load_scene(keys), roulette=False, folder=tmp_path)
    light, ball, flat = found["lamps"]
    frames = [np.array(lamp["world"]) for lamp in found["lamps"]]
    for frame in frames:
        assert np.linalg.det(frame[:3, :3]) == pytest.approx(1)
    assert -frames[0][:3, 2] * np.linalg.norm(sun["direction"]) == pytest.approx(sun["direction"])
    assert light["color"] == sun["irradiance"]
    assert ball["radius"] == 0.05
    assert frames[1][:3, 3] == pytest.approx([1, 2, 3])
    assert ball["color"] == pytest.approx([4, 8, 12])  # that of glass, which its surface divides by the square of 1.5
    assert frames[2][:3, 3] == pytest.approx([0.25, 4, 0.125])
    assert -frames[2][:3, 2] == pytest.approx([0, -1, 0])
    assert np.abs(frames[2][:3, :2]) @ flat["size"] == pytest.approx([0.5, 0, 0.25])
    black = [np.load(mesh["file"])["points"] for mesh in found["meshes"] if mesh["look"].get("color") == [0, 0, 0]]
    assert np.linalg.norm(black[0] - [1, 2, 3], axis=1).max() < 0.05
    assert black[1][:, 1] == pytest.approx(4.0001)  # behind the panel
    assert (found["camera"]["aperture_radius"], found["camera"]["focus_distance"]) == (0.02, 3.0)


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="bpy is not installed")
@pytest.mark.parametrize(
    ("name", "spp", "tolerance"),
    [(name, 128, 2e-3) for name in ("A_lens", "B", "C", "D")]
    + [(name, 512, 1e-2) for name in ("picture_of_light", "metal_floor", "sun_through_a_window", "hidden_uplighter")],
)
def test_cycles_renders_the_same_picture(name: str, spp: int, tolerance: float, tmp_path: Path) -> None:
    scene = reference_scene(name, shrink=4)
    worker = Worker(sys.executable, "benchmarks.cycles_worker")
    worker.ask(do="load", description=cycles_scene.describe(scene, roulette=False, folder=tmp_path))
    found = worker.ask(do="render", spp=spp, seed=1)
    worker.close()
    assert found["mean"] == pytest.approx(render(scene, spp=spp).pixels.mean(axis=(0, 1)), rel=tolerance)


@pytest.mark.slow
def test_measures_of_contrast_are_compared(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "focus_measures")
    assert "| wavelet" in printed
    figures = results["16"]["fine spots"]["wavelet"]
    assert figures["monotonic"] > 0.8
    assert all(abs(miss) < 1 for miss in figures["argmax"])


@pytest.mark.slow
def test_continuous_focus_is_counted_by_speed(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "continuous_focus")
    assert "| 1.4 m/s, from 6 to 1.2 m" in printed
    assert results["1.4 m/s, from 6 to 1.2 m"]["0.05"]["share"] >= 0.95


@pytest.mark.slow
def test_curve_of_the_paper_is_drawn(checkout: Path, tmp_path: Path) -> None:
    plot = tmp_path / "curve.svg"
    printed, results = quick(checkout, tmp_path, "paper_focus", "--seeds", "2", "--plot", str(plot))
    assert "variance of the picture" in printed
    contrast = [sum(row) for row in results["wavelet contrast of the zone"]]
    assert contrast[1] == max(contrast)  # of 20, 25 and 30 units
    assert plot.read_text("utf-8").startswith("<svg")


@pytest.mark.slow
def test_viewfinder_answers_dials_and_a_drag(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "viewfinder")
    assert "| drag " in printed
    assert all(each["ms"] > 0 for each in results["f_number"])
    assert results["drag"]["frames_per_second"] > 0


@pytest.mark.slow
@needs_chromium
def test_viewfinder_is_measured_in_a_browser(checkout: Path, tmp_path: Path) -> None:
    printed, results = quick(checkout, tmp_path, "viewfinder_browser")
    assert "pictures painted a second" in printed
    assert len(results["f_number"]) == len(results["focus_m"]) == 3
    assert all(found["ms"] > 0 for found in results["f_number"])
    assert results["drag"]["frames_per_second"] > 0
