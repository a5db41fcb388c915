"""Reads one mesh file with one library; prints CPU time [s], peak memory of the process [bytes] and triangles.

python -m benchmarks.mesh_reader {rptcam,trimesh} FILE
"""

import resource
import sys
import time
from pathlib import Path

from benchmarks.peak_of import greatest_memory

MOST_MEMORY = 10 << 30  # bytes; what takes more fails, and the machine stays usable


def with_rptcam(path: Path) -> int:
    """Return the number of triangles that our reader finds."""
    from rptcam_cl.scene.meshes import read_draft

    draft = read_draft(path, Path)
    return sum(len(surface.faces) for surface in draft.surfaces)


def with_trimesh(path: Path) -> int:
    """Return the number of triangles that trimesh finds."""
    import trimesh

    return len(trimesh.load_mesh(path, process=False).faces)


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    read = {"rptcam": with_rptcam, "trimesh": with_trimesh}[sys.argv[1]]
    read(Path(sys.argv[2]).with_name(f"small{Path(sys.argv[2]).suffix}"))  # imports and first calls do not count
    begun = time.process_time()
    triangles = read(Path(sys.argv[2]))
    print(time.process_time() - begun, greatest_memory(), triangles)
