"""The worker that asks Mitsuba 3 what rays meet. Requests: ``load`` a mesh file, ``trace`` the rays of a file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from benchmarks.mitsuba_worker import VARIANT, ready_mitsuba
from benchmarks.stopwatch import timed
from benchmarks.worker import serve


def start() -> tuple[str, Callable[[dict[str, Any]], dict[str, Any]]]:
    """Return the description of the renderer and its answers."""
    mitsuba = ready_mitsuba()
    import drjit
    import numpy as np

    held: dict[str, Any] = {}

    def load(request: dict[str, Any]) -> None:
        mesh = {"type": "ply", "filename": request["mesh"], "face_normals": True}
        held["scene"] = mitsuba.load_dict({"type": "scene", "mesh": mesh})

    def trace(request: dict[str, Any]) -> dict[str, Any]:
        if request["rays"] not in held:
            rows = np.load(request["rays"])
            origins, directions = mitsuba.Point3f(rows[:3]), mitsuba.Vector3f(rows[3:6])
            held[request["rays"]] = mitsuba.Ray3f(origins, directions, mitsuba.Float(rows[6]), 0.0, [])
            drjit.eval(held[request["rays"]])
        ray, scene, met = held[request["rays"]], held["scene"], []

        def query() -> None:
            if request["shadow"]:
                met[:] = [scene.ray_test(ray)]
            else:
                hit = scene.ray_intersect(ray)
                met[:] = [hit.t, hit.prim_index, hit.is_valid()]
            drjit.eval(*met)
            drjit.sync_thread()

        times = timed(query)
        if "save" in request:
            if request["shadow"]:
                rows = np.array(met[0])[None].astype(np.float32)
            else:
                t, valid = np.array(met[0]), np.array(met[2])
                rows = np.stack([t, np.where(valid, np.array(met[1]).astype(np.int64), -1)]).astype(np.float64)
            np.save(request["save"], rows)
        return {"wall": times.wall, "cpu": times.cpu}

    def respond(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "load":
            load(request)
            return {}
        return trace(request)

    return f"Mitsuba {mitsuba.__version__} {VARIANT}", respond


if __name__ == "__main__":
    serve(start)
