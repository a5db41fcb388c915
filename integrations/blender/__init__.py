"""rptcam_cl as a render engine of Blender: real lenses in front of Blender's scenes.

Only `reader`, `engine` and `panels` import Blender; they are imported when the extension is enabled.
"""

from __future__ import annotations


def register() -> None:
    """Enable the engine and its panels."""
    from . import drivers

    drivers.name_drivers()  # before OpenCL is loaded
    from . import engine, panels

    panels.register()
    engine.register()


def unregister() -> None:
    """Disable them."""
    from . import engine, panels

    engine.unregister()
    panels.unregister()
