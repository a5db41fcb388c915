"""What a file says about how a surface looks, in the terms of glTF's metallic-roughness materials."""

from __future__ import annotations

from dataclasses import dataclass

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Look:
    """A material of a mesh file.

    Attributes
    ----------
    name : str
    base_colour : (red, green, blue)
        Linear, 0 to 1.
    emission : (red, green, blue)
        Radiance, linear.
    """

    name: str = ""
    base_colour: Colour = (0.8, 0.8, 0.8)
    emission: Colour = (0.0, 0.0, 0.0)
