"""The layers of an image: what its samples have recorded, under the names that files give it, and the sharp ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.imaging import CRYPTOMATTE_NAMES, ranked
from rptcam_cl.plan import Plan
from rptcam_cl.rendering import AnyWavefront, GroundTruth, SceneBuffers, Wavefront, ground_truth_of
from rptcam_cl.scene import LayerName, Scene


def truth_of(
    scene: Scene, plan: Plan, wavefront: AnyWavefront, layers: tuple[LayerName, ...], settings: RenderSettings
) -> GroundTruth | None:
    """Return the sharp layers of a resolved scene; None where it is to have none."""
    session = wavefront.session

    def buffers() -> SceneBuffers:
        return wavefront.scene_buffers if isinstance(wavefront, Wavefront) else SceneBuffers(session, plan)

    def as_rendered(frame: Scene | None) -> Scene | None:
        if frame is None:
            return None
        applied = settings.applied_to(frame)
        if applied.requested_autofocus is None:
            return applied
        from rptcam_cl.focusing import in_focus  # few scenes have it, and its room takes long to import

        return in_focus(applied, session, None)[0]

    flows = settings.neighbours if {"flow_forward", "flow_backward"} & set(layers) else None
    neighbours = None if flows is None else (as_rendered(flows[0]), as_rendered(flows[1]))
    return ground_truth_of(scene, plan, session, buffers, layers, neighbours)


def named_layers(
    names: Sequence[LayerName],
    recorded: Mapping[str, NDArray[Any]],
    sharp: tuple[Mapping[str, NDArray[Any]], Mapping[str, Any]] | None,
    metadata: dict[str, Any],
) -> dict[str, NDArray[Any]]:
    """Return the layers of an image in their order; what the sharp ones have to say goes to the metadata.

    Parameters
    ----------
    names
        Those that it is to have.
    recorded
        Layers of the samples.
    sharp
        The sharp ones, and what they have to say.
    metadata
        Of the image, with the names of what identifiers stand for.
    """
    found = dict(recorded)
    for name, key in CRYPTOMATTE_NAMES.items():
        if name in found:
            found[name] = ranked(found[name], metadata[key])
    if sharp is not None:
        found |= sharp[0]
        metadata |= sharp[1]
    return {name: found[name] for name in names}
