"""The figures of the rptcam paper (Kumar, Kumar, Meng, Yu, 2024)."""

from __future__ import annotations

import json
from typing import Any

from examples.figures.colour_numbers import (
    DOUBLET_PLACED,
    PLACED,
    blurs_by_wavelength,
    focus_by_wavelength,
    glasses,
    singlet,
    white,
)
from examples.figures.figure import Drawing, Figure, Group, Section, shared
from examples.figures.paper_film_numbers import (
    blurs_of_distances,
    blurs_of_lamps,
    blurs_of_stops,
    climbs,
    found_by_autofocus,
)
from examples.figures.paper_lens_numbers import (
    doublet_drawing,
    doublet_of_the_paper,
    focal_lengths,
    indices,
    paper_doublet,
    placements,
    snell,
    table_prescription,
    thick_placements,
)

QUARTER = "film.crop=[0.42, 0.92, 0.3, 0.8]"
FILM = "camera.focus.film_distance_mm"
CROP = "film.crop=[0.06, 0.94, 0.29, 0.8]"


def bokeh(name: str, title: str, aperture: str) -> Figure:
    """Return figure 1 through one opening."""
    changes = (CROP, f"camera.aperture={aperture}", "picture.ev=1")
    return Figure(f"paper_1_{name}", title, "paper/figure_1.yaml", changes, (1100, 825), 128)


def basic(name: str, title: str, *changes: str) -> Figure:
    """Return the scene of figures 2 and 3 with some changes."""
    return Figure(f"paper_{name}", title, "paper/figure_2.yaml", (*changes, "picture.ev=1"))


def inline(lens: dict[str, Any]) -> str:
    """Return a lens as a value for the command line."""
    return json.dumps(lens)


def colour(name: str, title: str, *changes: str) -> Figure:
    """Return a quarter of the picture of figures 4 and 7 with some changes."""
    return Figure(f"paper_{name}", title, "paper/figure_4.yaml", (*changes, QUARTER), (1920, 1440), 256)


def distance(units: int) -> Figure:
    """Return figure 5 focused at a distance."""
    changes = (f"camera.focus={{distance_m: {units / 1000:g}}}",)
    return Figure(f"paper_5_{units}", f"{units} units", "paper/autofocus.yaml", changes)


def table_lens(name: str, title: str, lens: str) -> Figure:
    """Return the balls of figure 5 through the lens of Table 1, 4 units from the film."""
    changes = (f"camera.lens={lens}", "camera.focus={film_distance_mm: 3.995}")
    return Figure(f"paper_table_{name}", title, "paper/autofocus.yaml", changes)


def started(units: int) -> Figure:
    """Return the scene of figure 8 where a climb starts."""
    return Figure(f"paper_8_{units}", f"start, {units} units", "paper/autofocus.yaml", distance(units).changes)


PAPER = Section(
    "rptcam (Kumar, Kumar, Meng, Yu, 2024)",
    """\
Its scenes are in units without a name; here one is a millimetre. Pictures stand upright, the paper's as they lie on
the film. Rays are bent by Snell's law; the paper's step 3 bends tangents in place of sines, which agrees near the
axis alone ([numbers](#snells-law)). Off the axis the blur of its pictures is therefore not that of such a lens; ours
is. The materials are ours: a diffuse base under a rough clear coat.""",
    (
        Group(
            "Table 1: its own lens",
            """\
Two faces of radius 4, an index of 1.6, 4 units from the film: in focus at 24. The balls are those of figure 5. By the
diameter that the table gives, 0.02, the blur of the nearest ball is four pixels and that of the others one; twenty
times as wide only the ball at 25 is nearly sharp.""",
            (
                table_lens("002", "0.02 across", "paper-biconvex"),
                table_lens("04", "0.4 across", inline(table_prescription(0.4))),
            ),
            theirs="the prescription of a lens, no picture.",
        ),
        Group(
            "Figure 1: the shape of the blur",
            """\
Five lamps, the green one in focus: a ball, whatever the opening. All others are pictures of the opening, the farther
behind the plane of focus the larger, and the same way up as it is seen from the camera. The nearest, orange and blue,
are hardly larger than their own size, which rounds their corners.""",
            (
                bokeh("circle", "circle", "{shape: circle}"),
                bokeh("heart", "heart", "{shape: heart}"),
                bokeh("star", "star", "{shape: star, points: 5}"),
                bokeh("polygon", "polygon, 6 blades", "{shape: polygon, blades: 6}"),
            ),
            (blurs_of_lamps,),
            theirs="five small lamps over a bright floor through a thin lens, by a circle and a heart.",
        ),
        Group(
            "Figure 2: three stops",
            """\
In focus is what lies 3.4 units behind the farther ball, which is sharp enough; the edge of the box, nearest to the
camera, shows what the stop does: blur is proportional to its diameter. The field is 100 degrees wide. Balls off the
axis are eggs, as on any flat film, and the corners get little light (cos⁴).""",
            (
                basic("2_d002", "stop 0.02", "camera.stop_diameter_mm=0.02"),
                basic("2_d005", "stop 0.05", "camera.stop_diameter_mm=0.05"),
                basic("2_d007", "stop 0.07", "camera.stop_diameter_mm=0.07"),
            ),
            (blurs_of_stops,),
            theirs="balls and a box through the single lens of index 1.8, at stops 0.02, 0.05 and 0.07 across.",
        ),
        Group(
            "Figure 3: three indices of refraction",
            """\
The paper moved the lens with its index by a formula that does not keep the focus: from far behind the scene it comes
to the balls at the sides (n = 2.3) and to the small one (n = 3.5). The lens distances are the paper's. The balls at
the sides are sharp towards the middle and soft towards the edge: a single lens has a curved field, and at 40 degrees
from the axis its focus is much nearer.""",
            (
                basic("2_d007", "n = 1.8", "camera.stop_diameter_mm=0.07"),
                basic(
                    "3_n23",
                    "n = 2.3",
                    "camera.lens.surfaces.0.glass.index=2.3",
                    "camera.focus.film_distance_mm=3.56358",
                ),
                basic(
                    "3_n35",
                    "n = 3.5",
                    "camera.lens.surfaces.0.glass.index=3.5",
                    "camera.focus.film_distance_mm=3.78365",
                ),
            ),
            (indices,),
            theirs="the scene of figure 2 at a stop of 0.07, through indices of 1.8, 2.3 and 3.5.",
        ),
        Group(
            "Figure 4: three Abbe numbers",
            """\
One index of 1.8 at 589.3 nm, linear in the wavelength as the paper has it, and Abbe numbers from glass (200 has
hardly any colour) to what no glass does (3). Shown is a quarter of the picture. Lamps get fringes, since for blue
the plane of focus lies nearer than for red.""",
            (
                colour("4_v200", "V = 200", "camera.lens.surfaces.0.glass.linear_abbe.v=200"),
                colour("4_v10", "V = 10", "camera.lens.surfaces.0.glass.linear_abbe.v=10"),
                colour("4_v3", "V = 3", "camera.lens.surfaces.0.glass.linear_abbe.v=3"),
            ),
            (blurs_by_wavelength,),
            theirs="a box and balls that shine, through Abbe numbers of 200, 10 and 3: fringes grow.",
        ),
        Group(
            "Figure 5: four distances in focus",
            """\
Four balls whose size grows with their distance; one after the other is sharp. "Formula" is the closed form, "our
lens" a ray near the axis, "our film" the blur that the camera's own rays leave, spherical aberration of the open
lens included: that is why it is not 0 in focus.""",
            tuple(distance(units) for units in (15, 20, 25, 30)),
            (blurs_of_distances,),
            theirs="four red balls 15, 20, 25 and 30 units from the film, sharp one after the other.",
        ),
        Group(
            "Figure 6: a doublet",
            """\
A doublet of real glasses by the paper's equations, BK7 and F2, of 100 units and with a first radius of 60
([numbers](#closed-forms)): blue, green and red light in one focus.""",
            drawings=(Drawing("paper_6_doublet", "doublet, 486, 546 and 656 nm", chart=doublet_drawing),),
            theirs="the section of a doublet of two glasses.",
        ),
        Group(
            "Figure 7: singlet and achromat",
            """\
Both focused 18 units from the film, on the middle ball; shown is a quarter of the picture. The doublet's two glasses
have Abbe numbers of 3 and 1, and its power, taken as thin, is the same at every wavelength. The single lens has
purple fringes; through the doublet a thread of orange is left, and the box is out of focus without colour.""",
            (
                colour(
                    "7_singlet", "single lens, V = 3", f"camera.lens={inline(singlet(3, 0.2))}", f"{FILM}={PLACED[18]}"
                ),
                colour("7_doublet", "doublet", f"camera.lens={inline(paper_doublet())}", f"{FILM}={DOUBLET_PLACED}"),
            ),
            (focus_by_wavelength,),
            theirs="the shining scene with purple fringes by a single lens, and without by the doublet.",
        ),
        Group(
            "Figure 8: autofocus",
            """\
The same scene. The paper's autofocus climbs the variance of the whole picture and is said to come to 25 units from
any start; that curve is flat within 1 % from 16 to 26 units here, and as broad in the paper's own renderer
([curves](autofocus.md#the-figures-of-the-paper)). Our climbs from both starts end on that plateau, at 19. Found here is
the sphere in the white rectangle, whose front is at 24.5 and whose rim is at 25, by its contrast and by its distance:
it is sharp in the picture, the nearest is not.""",
            (started(50), started(15), shared("autofocus_paper", "found by contrast")),
            (found_by_autofocus,),
            drawings=(Drawing("paper_8_climbs", "climbs of the variance", chart=climbs),),
            theirs="autofocus that climbs to 25 units from any start.",
        ),
        Group(
            "Snell's law",
            """\
Where rays far from the axis are in focus, by the law that bends sines, by the paper's, which bends tangents, and
through our lens. The two differ in the sign of spherical aberration: in the document rays far from the axis meet
farther off than those near it, here nearer, as through glass. There is no picture of it.""",
            (),
            (snell,),
        ),
        Group(
            "White",
            """\
The paper gives each wavelength a colour and divides by its length, so that a white world turns orange-brown and a fifth
darker. Here the colours of all wavelengths add up to white, to 0.2 %: an even picture, not shown.""",
            (),
            (white,),
        ),
        Group(
            "Closed forms",
            """\
Equations 3 to 12 of the paper, by `rptcam_cl.optics.design`. At four focal lengths the object is as near as it can be
and the two roots are one. Equation 12 lacks a minus sign: an achromat needs P1/V1 + P2/V2 = 0. Formulas, not pictures:
ours agree to the last digit, but where a lens as thick as it is takes the place of a thin one.""",
            (),
            (placements, thick_placements, focal_lengths, doublet_of_the_paper, glasses),
        ),
    ),
)
