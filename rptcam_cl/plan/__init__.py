"""From a scene to what a device needs: records, and the facts that say which code the scene requires."""

from rptcam_cl.plan.albedo import LargestAlbedo
from rptcam_cl.plan.bright_parts import bright_parts
from rptcam_cl.plan.mirror_faces import Bend, Faces, Outline, joined, polished_count, polished_faces
from rptcam_cl.plan.motion import Movements, Places
from rptcam_cl.plan.packed_meshes import PackedMeshes, TriangleGroup, shifted
from rptcam_cl.plan.parts import PlanParts
from rptcam_cl.plan.plan import Plan, aimed, make_plan, may_aim, with_film, with_lens, with_pose
from rptcam_cl.plan.polish import SPREADING_ALPHA, Lobe, lobes_of
from rptcam_cl.plan.primitives import object_frame
from rptcam_cl.plan.spectrum import observer

__all__ = [
    "SPREADING_ALPHA",
    "Bend",
    "Faces",
    "LargestAlbedo",
    "Lobe",
    "Movements",
    "Outline",
    "PackedMeshes",
    "Places",
    "Plan",
    "PlanParts",
    "TriangleGroup",
    "aimed",
    "bright_parts",
    "joined",
    "lobes_of",
    "make_plan",
    "may_aim",
    "object_frame",
    "observer",
    "polished_count",
    "polished_faces",
    "shifted",
    "with_film",
    "with_lens",
    "with_pose",
]
