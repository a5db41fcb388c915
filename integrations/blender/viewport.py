"""The viewport: which view it shows, and how a film gets onto it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gpu
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.presets import draw_texture_2d
from mathutils import Matrix
from numpy.typing import NDArray

from .camera import BlenderCamera, Frame
from .reader import Eye, matrix_of, record_of

WIDEST = 1920  # pixels that a viewport renders across at most


@dataclass(frozen=True)
class View:
    """A view of a region: what is rendered, and where it is drawn: left, bottom, width, height [pixels]."""

    eye: Eye
    rectangle: tuple[float, float, float, float]
    through_camera: bool

    def __eq__(self, other: object) -> bool:
        return isinstance(other, View) and self._content() == other._content()

    def _content(self) -> tuple[Any, ...]:
        camera = self.eye.camera
        plain = {name: value for name, value in vars(camera).items() if name not in ("matrix", "matrix_end")}
        return self.rectangle, self.through_camera, self.eye.frame, camera.matrix.tobytes(), tuple(plain.items())


def view_of(context: Any) -> View:
    """What a viewport shows: the frame of the camera, or the region."""
    region, space = context.region, context.region_data
    if space.view_perspective == "CAMERA" and context.scene.camera is not None:
        return _through_camera(context)
    projection = np.array(space.window_matrix, np.float64)
    frame = Frame(_fitted(region.width, region.height))
    matrix = matrix_of(space.view_matrix.inverted())
    width = 36.0
    if space.view_perspective == "ORTHO":
        scale = 2 / min(projection[0, 0], projection[1, 1])
        camera = BlenderCamera(matrix, sensor_mm=(width, width), kind="ORTHO", ortho_scale=scale)
    else:
        camera = BlenderCamera(
            matrix, lens_mm=float(projection[0, 0]) * width / 2, sensor_mm=(width, width), sensor_fit="HORIZONTAL"
        )
    return View(Eye(camera, frame), (0, 0, region.width, region.height), False)


def _through_camera(context: Any) -> View:
    left, bottom, width, height = frame_in(context.region, context.region_data, context.scene)
    render = context.scene.render
    aspect = (render.pixel_aspect_x, render.pixel_aspect_y)
    frame = Frame(_fitted(round(width), round(height)), aspect if aspect[0] != aspect[1] else (1.0, 1.0))
    return View(Eye(record_of(context.scene.camera), frame), (left, bottom, width, height), True)


def frame_in(region: Any, space: Any, scene: Any) -> tuple[float, float, float, float]:
    """Left, bottom, width and height [pixels] of the camera's frame in a region that looks through it."""
    item = scene.camera
    corners = item.data.view_frame(scene=scene)
    world = item.matrix_world @ Matrix.Diagonal((*(1 / s for s in item.matrix_world.to_scale()), 1.0))
    places = [location_3d_to_region_2d(region, space, world @ corner, default=(0, 0)) for corner in corners]
    x0, y0 = (min(place[i] for place in places) for i in range(2))
    x1, y1 = (max(place[i] for place in places) for i in range(2))
    return x0, y0, x1 - x0, y1 - y0


def point_at(screen: Any, scene: Any, x: int, y: int) -> tuple[float, float] | None:
    """The point of the picture, in fractions from its left and top edges, that shows at a pixel of the window.

    None where no viewport looks through the camera there, or beside its frame.
    """
    for area in screen.areas:
        for region in area.regions if area.type == "VIEW_3D" else ():
            inside = 0 <= x - region.x < region.width and 0 <= y - region.y < region.height
            space = area.spaces.active.region_3d
            if not inside or region.type != "WINDOW" or space.view_perspective != "CAMERA" or scene.camera is None:
                continue
            left, bottom, width, height = frame_in(region, space, scene)
            u, v = (x + 0.5 - region.x - left) / width, 1 - (y + 0.5 - region.y - bottom) / height
            return (u, v) if 0 <= u <= 1 and 0 <= v <= 1 else None
    return None


def _fitted(width: int, height: int) -> tuple[int, int]:
    share = min(WIDEST / max(width, height, 1), 1.0)
    return max(round(width * share), 1), max(round(height * share), 1)


def draw(engine: Any, scene: Any, pixels: NDArray[np.float32], rectangle: tuple[float, float, float, float]) -> None:
    """Draw a film, colours managed as Blender's."""
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels[::-1], np.float32)
    buffer = gpu.types.Buffer("FLOAT", rows.size, rows.ravel())
    texture = gpu.types.GPUTexture((width, height), format="RGBA16F", data=buffer)
    gpu.state.blend_set("ALPHA_PREMULT")
    engine.bind_display_space_shader(scene)
    draw_texture_2d(texture, rectangle[:2], rectangle[2], rectangle[3])
    engine.unbind_display_space_shader()
    gpu.state.blend_set("NONE")
