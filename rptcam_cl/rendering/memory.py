"""What a render will hold on the device, added up before anything is allocated: running out kills a CPU's process."""

from __future__ import annotations

from collections.abc import Sequence

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.host_memory import free_host_bytes
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.photon_passes import PHOTON_BYTES

SHARE = 0.8  # of the memory that a render may plan to use
# Upper bounds over the meshes that were measured (benchmarks/journal.md): nodes and leaf blocks on the device (51 on
# smooth meshes, whose blocks are nine tenths full), and on a CPU what building them takes besides for a while.
TREE_BYTES_PER_TRIANGLE = 80
BUILD_BYTES_PER_TRIANGLE = 90
SMALLER_FILM = "render a part with crop, or lower film.resolution"
FEWER_TRIANGLES = "use meshes of fewer triangles, or several objects of one mesh"
SMALLER_PICTURES = "use smaller pictures"


@dataclass(frozen=True)
class MemoryNeeds:
    """Bytes by use.

    Attributes
    ----------
    film, paths, triangles, textures, rest : int
        Sums and layers per pixel; state of a wave; meshes with their trees; texels; all other arrays of the scene.
    building : int
        Needed only while trees are built, and only where device and host share their memory.
    largest : tuple
        The largest buffer: for what it is, its bytes, and what would make it smaller.
    """

    film: int
    paths: int
    triangles: int
    textures: int
    rest: int
    building: int
    largest: tuple[str, int, str] = ("nothing", 0, "")

    @property
    def total(self) -> int:
        """All of it at its highest."""
        return self.film + self.triangles + self.textures + self.rest + max(self.paths, self.building)


def memory_needs(plan: Plan, session: Session, *, film: Sequence[int], paths: Sequence[int]) -> MemoryNeeds:
    """Return what a plan needs besides the buffers of ``film`` and ``paths`` [bytes each]."""
    triangles = building = 0
    if plan.meshes is not None:
        count = len(plan.meshes.triangles)
        triangles = plan.meshes.vertices.nbytes + plan.meshes.triangles.nbytes + TREE_BYTES_PER_TRIANGLE * count
        building = BUILD_BYTES_PER_TRIANGLE * count if session.info.type == "cpu" else 0
    textures = plan.textures.texels.nbytes + plan.surroundings.distribution.nbytes
    rest = plan.primitives.nbytes + plan.materials.nbytes + plan.emitters.records.nbytes + plan.emitters.curve.nbytes
    rest += plan.emitters.tree.nodes.nbytes if plan.emitters.tree is not None else 0
    rest += plan.caustics.surfaces.nbytes + PHOTON_BYTES if plan.caustics.active else 0
    buffers = [
        ("the film", max(film), SMALLER_FILM),
        ("the paths of a wave", max(paths), "use waves of fewer paths"),
        ("the pixels of pictures", plan.textures.texels.nbytes, SMALLER_PICTURES),
        ("the picture around the scene", plan.surroundings.distribution.nbytes, SMALLER_PICTURES),
    ]
    if plan.meshes is not None:
        buffers += [
            ("vertices", plan.meshes.vertices.nbytes, FEWER_TRIANGLES),
            ("triangles", plan.meshes.triangles.nbytes, FEWER_TRIANGLES),
        ]
    return MemoryNeeds(
        sum(film), sum(paths), triangles, textures, rest, building, max(buffers, key=lambda each: each[1])
    )


def check_memory(needs: MemoryNeeds, session: Session) -> None:
    """Refuse a render that the device cannot hold, all together or in one of its buffers.

    Raises
    ------
    InputError
        With every use that matters, and what would make it smaller.
    """
    what, size, cure = needs.largest
    if size > session.largest_buffer_bytes:
        raise InputError(
            f"the scene needs {amount(size)} for {what}; device {session.info.id} takes at most"
            f" {amount(session.largest_buffer_bytes)} in one piece ({cure})"
        )
    budget = memory_budget(session)
    if needs.total <= budget:
        return
    parts = {
        "the film": needs.film,
        "the paths": needs.paths,
        "triangles and their trees": needs.triangles,
        "building those trees": needs.building,
        "textures": needs.textures,
        "the rest of the scene": needs.rest,
    }
    listed = ", ".join(f"{amount(count)} for {name}" for name, count in parts.items() if count >= 0.01 * needs.total)
    cure = max(
        (needs.film, SMALLER_FILM),
        (needs.triangles + needs.building, FEWER_TRIANGLES),
        (needs.textures, SMALLER_PICTURES),
    )[1]
    raise InputError(
        f"the scene needs {amount(needs.total)}: {listed}; device {session.info.id} offers {amount(budget)} ({cure})"
    )


def memory_budget(session: Session) -> int:
    """Return how much memory a render may plan with [bytes]; on a CPU also not more than the host has free."""
    offered = session.info.memory_bytes
    if session.info.type == "cpu" and (free := free_host_bytes()) is not None:
        offered = min(offered, free)
    return int(SHARE * offered)


def amount(count: int) -> str:
    """Return a number of bytes as people read it."""
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count} bytes"
