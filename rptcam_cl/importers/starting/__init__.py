"""A first scene round a model: framed, lit, focused and exposed, to be changed from there."""

from rptcam_cl.importers.starting.start import Start, Wishes, starting_scene

__all__ = [
    "Start",
    "Wishes",
    "starting_scene",
]
