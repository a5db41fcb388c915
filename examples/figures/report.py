"""The figures of the camera report after chapter 6 of Physically Based Rendering."""

from __future__ import annotations

from examples.figures.blur_graph import confusion_graph, thin_lens_rays
from examples.figures.figure import Drawing, Figure, Group, Section, shared
from examples.figures.report_numbers import (
    ball,
    biconcave_disks,
    blurs_of_balls,
    confusion_points,
    focus_of_balls,
    retries,
    seen,
)


def photographic(lens: str, title: str) -> Figure:
    """Return the small room through a lens of several elements."""
    changes = (f"camera.lens={lens}", "film.width_mm=36", "camera.focus.distance_m=0.385")
    return Figure(f"report_{lens}", title, "report/lens.yaml", changes, (960, 640), 64)


def rays_of(lens: str, title: str, *options: str) -> Drawing:
    """Return a lens in cross-section, with its rays of two points."""
    words = ("lens", "draw", lens, *options, "--fields", "0,8")
    return Drawing(f"report_rays_{lens}", title, words)


FOCUSED = ("--focus-distance-m", "0.4")

REPORT = Section(
    "Camera report after PBRT, chapter 6: figures 2 to 17",
    """\
The report's rooms are models that are not given; a room with three balls takes their place, and the same room at a
tenth of the size where there are lenses. [The gallery](../examples/README.md#cameras-without-glass) says more about
most of these pictures.""",
    (
        Group(
            "Pinhole and environment",
            "90 degrees, sharp from front to back; and all directions, twice as wide as high.",
            (shared("pinhole", "pinhole"), shared("environment", "environment")),
            (seen,),
            theirs="rooms through a pinhole 90 degrees wide, and all around in a picture twice as wide as high.",
        ),
        Group(
            "Thin lens: three distances in focus",
            """\
Radius 0.1 m: the red ball at 2 m, the gold one at 3 m and the blue one at 4 m are sharp in turn. Below, where the
blur ends, from the blur of a card a fifth nearer and of one a quarter farther.""",
            tuple(shared(f"thin_lens_focus_{distance}", f"{distance} m") for distance in (2, 3, 4)),
            (focus_of_balls,),
            theirs="a room at an aperture radius of 0.1, focused at 2, 3 and 4.",
        ),
        Group(
            "Thin lens: three openings",
            """\
Focused at 3 m. The report has it the wrong way round in its text: the larger the opening, the *smaller* the depth of
field. The blur of the red and the blue ball doubles with the opening.""",
            (
                shared("thin_lens_aperture_005", "radius 0.05 m"),
                shared("thin_lens_focus_3", "radius 0.1 m"),
                shared("thin_lens_aperture_02", "radius 0.2 m"),
            ),
            (blurs_of_balls,),
            theirs="the same focused at 3, at radii of 0.05, 0.1 and 0.2.",
        ),
        Group(
            "How the rays go",
            """\
Light of one point that goes through a thin lens meets in one point again. On a film nearer or farther than that it has
the width of the *circle of confusion*: the aperture's share of the way that is left. The graph grows without bound
towards the lens and levels off behind the focus; its points, our camera's, lie on the curves of the formula, as the
table says. Through real glass light of the rim meets before that of the middle; a stop in front leaves the middle
alone; a biconcave lens spreads whatever comes.""",
            (),
            (confusion_points,),
            (
                Drawing("report_thin_lens_rays", "a thin lens", chart=thin_lens_rays),
                Drawing("report_circle_of_confusion", "the circle of confusion", chart=confusion_graph),
                rays_of("ball", "ball", *FOCUSED),
                rays_of("biconvex", "biconvex", *FOCUSED),
                rays_of("biconvex-stop", "biconvex with a stop", *FOCUSED),
                rays_of("biconcave", "biconcave"),
            ),
            theirs="figures 4, 5 and 8, diagrams of rays and a graph of the circle of confusion.",
        ),
        Group(
            "No lens, and a ball",
            """\
A hole of 0.3 mm draws upside down, as shown, and all distances alike; a ball draws a core under a veil of spherical
aberration, and with the film 9.5 mm farther away nothing but blurs. A waist of a tenth of the ball's radius takes the
veil away.""",
            (
                shared("no_lens", "no lens"),
                shared("ball_in_focus", "ball in focus"),
                shared("ball_out_of_focus", "ball out of focus"),
                shared("ball_with_waist", "ball with a waist, R / 10"),
            ),
            (ball,),
            theirs="a hole without glass; a ball in focus, out of focus, and with a waist of about R / 10.",
        ),
        Group(
            "Single lenses",
            """\
The biconvex lens is sharp in the middle, on the gold ball and the near side of the red one; a stop in front sharpens
the rest, and bends the lines of the wall outwards. The biconcave one, 20 mm open, leaves an even grey; 1 mm open on
both surfaces, as the report has it, it draws as a wide pinhole does. Its disks are in proportion to the opening, at any
film distance. That in the report all is sharp at every distance is due to its small scene beside its lens.""",
            (
                shared("biconvex", "biconvex"),
                shared("biconvex_stop", "with a stop"),
                shared("biconcave", "biconcave, 20 mm"),
                shared("biconcave_small", "biconcave, 1 mm"),
            ),
            (biconcave_disks,),
            theirs="a biconvex lens, the same with a stop, and a biconcave one 1 mm open, all with an image.",
        ),
        Group(
            "Lenses of several elements",
            """\
All three focused on the gold ball, on the same film of 36 mm. The report's wide angle is "very dim", and its double
Gauss hardly darker towards the edge, since its renderer tries up to ten times per sample and weights nothing else: that
makes 1 - (1 - p)^10 of the share p of the rays that pass. Measured against the light on the axis, as here, only the
corners are dark.""",
            (
                photographic("wide-22mm", "wide angle 22 mm"),
                photographic("dgauss-50mm", "double Gauss 50 mm"),
                photographic("fisheye-10mm", "fisheye 10 mm"),
            ),
            (retries,),
            theirs="a wide angle (very dim), a double Gauss and a fisheye.",
        ),
    ),
)
