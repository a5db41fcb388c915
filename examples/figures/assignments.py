"""The figures of CS348b's camera assignments of 2015 and 2003."""

from __future__ import annotations

from dataclasses import replace

from examples.figures.assignment_film_numbers import (
    aimed_shares,
    depths,
    floor_light,
    half_stop,
    irradiances,
    lit_floors,
    passing_shares,
    shape_light,
)
from examples.figures.figure import Figure, Group, Section, shared
from examples.figures.first_order_numbers import first_order, fitted_films, focus_and_circle, focus_rays, kolb, stops
from examples.figures.focus_numbers import accepted_distances, autofocus_targets
from examples.figures.numbers import Numbers

FOUR = {
    "cones_dgauss": "double Gauss",
    "cones_wide": "wide angle",
    "cones_fisheye": "fisheye",
    "cones_telephoto": "telephoto",
}
EYES = {"0.5": 15.905, "1": 14.702, "2": 14.151}  # the first vertex stands at the origin


def shares_of_four() -> Numbers:
    """Compare the share of rays that pass the four lenses, aimed as they are, with one."""
    return aimed_shares(tuple(FOUR))


def at_four_samples(name: str, title: str) -> Figure:
    """Return a picture of the gallery with four samples per pixel."""
    picture = shared(name, title)
    return replace(picture, name=f"{name}_4spp", size=(300, 300), spp=4, folder="figures", denoise=False)


def fitted(name: str, title: str, f_number: float, diagonal_mm: float) -> Figure:
    """Return a picture of the cones at an f-number, on a square film whose sides touch the image circle."""
    picture = shared(name, title)
    changes = [*picture.changes, f"camera.f_number={f_number:g}", f"film.diagonal_mm={diagonal_mm:g}"]
    new = f"{name}_reference"
    return replace(picture, name=new, changes=changes, size=(960, 960), spp=48, folder="figures")


def found(name: str, title: str, *changes: str) -> Figure:
    """Return the card and the wall, one of which autofocus finds."""
    return Figure(f"assignment_autofocus_{name}", title, "assignment/autofocus.yaml", changes, (720, 720), 96)


def bunnies(policy: str) -> Figure:
    """Return the two bunnies, one of which autofocus finds."""
    change = f"camera.focus.auto.policy={policy}"
    return Figure(f"assignment_bunnies_{policy}", policy, "assignment/bunnies.yaml", (change,), (960, 640))


def found_by_telephoto() -> Figure:
    """Return the telephoto's picture of the cones, focused by itself on the text."""
    picture = shared("cones_telephoto", "telephoto, on the text")
    auto = "camera.focus={auto: {zones: [[0.70, 0.76, 0.40, 0.46]], draw_zones: true}}"
    changes = [change for change in picture.changes if not change.startswith("camera.focus")]
    name, size = "assignment_autofocus_text", (720, 720)
    return replace(picture, name=name, changes=[*changes, auto], size=size, spp=96, folder="figures")


def stop_shape(name: str, title: str, aperture: str) -> Figure:
    """Return the chess board through a shaped stop."""
    changes = (f"camera.aperture={aperture}", "film.crop=[0.1, 0.9, 0, 0.6]")
    return Figure(f"assignment_bokeh_{name}", title, "first_light.yaml", changes, (1200, 675), 512)


def targets(name: str, title: str, *changes: str) -> Figure:
    """Return the three cards with some changes."""
    return Figure(f"assignment_{name}", title, "assignment/cards.yaml", changes, (960, 640), 256)


def focused(metres: str) -> Figure:
    """Return the three cards, focused at a distance from the first vertex."""
    changes = (f"camera.focus.front_distance_m={metres}", f"camera.eye=[0, 0, {EYES[metres]}]")
    return targets(f"focus_{metres.replace('.', '')}", f"{metres} m", *changes)


ASSIGNMENT_2015 = Section(
    "CS348b 2015, assignment 3",
    """\
Thirteen cones on a film of 70 mm across, the film distances of the assignment, whose pictures are of 300 x 300 pixels.
The text on every third cone is the assignment's in other letters; plain colours take the place of two measured paints.
The seven written questions are answered in [theory.md](theory.md).""",
    (
        Group(
            "Four lenses, 4 samples per pixel",
            """\
What is left of the noise is that of the lamp, a disk eight units in radius, and of the blur: the wide angle has no
more of it than the double Gauss. Inside the image circle nine of ten samples and more get through the lens, since rays
aim at what their film point sees of the pupil.""",
            tuple(at_four_samples(name, title) for name, title in FOUR.items()),
            (shares_of_four,),
            theirs="the four pictures with much noise, most of all the wide angle's: one ray in seven gets through.",
        ),
        Group(
            "Four lenses without noise",
            """\
The same with the noise gone. All is sharp from the cones on through the short lenses; the telephoto makes the text of
its cone readable, as the assignment has it. Below, the lenses to first order, places from the first vertex towards the
scene; what they focus on and how far they light the film; and where the things of the scene are.""",
            tuple(shared(name, title) for name, title in FOUR.items()),
            (first_order, focus_and_circle, depths),
            theirs="round pictures, by a student 171.5, 153.9 and 82.0 pixels in radius, and the telephoto's square.",
        ),
        Group(
            "The telephoto with half its stop",
            """\
Half the blur, see the lines of the floor and of the wall, and two stops less light (the pictures are scaled by what
reaches the centre). Below, the irradiance of the film in a world of radiance 1, at distances from its centre:
"expected" is an independent Monte Carlo estimate with an error of 0.4 %, whose rays go to the whole rear disk;
"float64" is a quadrature over rays in double precision.""",
            (shared("cones_telephoto", "stop 40.5 mm"), shared("cones_telephoto_half", "stop 20.25 mm")),
            (irradiances, passing_shares, half_stop),
            theirs="the text of the cone at the full stop of 40.5 mm and at half of it, two stops darker.",
        ),
        Group(
            "How bright",
            """\
The scene without its walls under the lamps of the assignment, `exposure: irradiance`: brightest hundredth of what
lies within 25 pixels of the centre. The prediction knows no vignetting within these 25 pixels. No picture belongs to
it: all four lenses are within 1 % of what is expected, and the light of the floor is within 0.5 %.""",
            (),
            (lit_floors, floor_light),
            theirs="how bright the middle is, as predicted and in reference pictures made elsewhere.",
        ),
        Group(
            "Autofocus",
            """\
White rectangles are the zones of the assignment's files `closeup`, `bg` and `telephoto`; such
[files](autofocus.md#zones) are read as they are. Of two zones the closest decides, and the text is sharp, or the
farthest, and the wall is. The telephoto finds the text on its cone. The cones with [two
zones](../examples/README.md#autofocus) are on the other page. Below, what autofocus finds in these pictures; then the
film distances that the assignment accepts, 62.09, 39.80 and 116.85 mm, beside our optima.""",
            (
                found("closest", "closest", "camera.focus.auto.policy=closest"),
                found("farthest", "farthest", "camera.focus.auto.policy=farthest"),
                found_by_telephoto(),
            ),
            (autofocus_targets, accepted_distances),
            theirs="a near cone, the far ones and the text, each sharp where the zone lies.",
        ),
        Group(
            "Autofocus: bunnies and spheres",
            """\
Models of ours, one scene, two zones: the near bunny is found by `policy: closest`, the far one by `policy: farthest`.
The red ball stands nearly as near as the first, the gold one between the two, the blue one behind the second.""",
            (bunnies("closest"), bunnies("farthest")),
            theirs="bunnies and spheres at several distances.",
        ),
        Group(
            "Bokeh",
            """\
[The chess board](../examples/README.md#first-light) through stops of other shapes, in the middle of a double Gauss.
Towards the edges rims cut the shapes as they cut disks. Each shape lies within the round stop, and takes as much of
its light as it has of its area.""",
            (
                stop_shape("blades", "five blades", "{shape: polygon, blades: 5}"),
                stop_shape("star", "star", "{shape: star, points: 5}"),
                stop_shape("heart", "heart", "{shape: heart}"),
            ),
            (shape_light,),
        ),
    ),
)

ASSIGNMENT_2003 = Section(
    "CS348b 2003, assignment 2",
    """\
A 100 mm double Gauss before three cards at 0.5, 1 and 2 m from its first vertex; models and scenes of the assignment
are not given.""",
    (
        Group(
            "Camera test: f-stops",
            """\
Focused at 1 m. At f/2 the thick lens, which knows principal planes and pupils alone, and the traced one draw nearly
the same; the corners of the second are darker. Stopping down deepens what is sharp. Stop diameters by the
assignment's rule, sin θ = 1 / (2 N) behind the lens:""",
            (
                targets("thick", "thick lens, f/2.03", "camera.kind=thick_lens"),
                replace(focused("1"), title="traced, f/2.03"),
                targets("f4", "traced, f/4", "camera.f_number=4"),
                targets("f16", "traced, f/16", "camera.f_number=16"),
            ),
            (stops, kolb),
            theirs="a camera test by several f-numbers; f/1.4 is more than the lens has.",
        ),
        Group(
            "Reference pictures: telephoto f/5.6, wide angle and fisheye f/4",
            """\
The models are not given; the cones of 2015 take their place. The films are squares that the image circle just touches:
50.8 mm for the wide angle, 26.9 mm for the fisheye, so that their pictures are round and end where the film does. The
telephoto's circle is larger than the film of 49.5 mm, which it fills to the corners, 70 mm apart.""",
            (
                fitted("cones_telephoto", "telephoto, f/5.6", 5.6, 70),
                fitted("cones_wide", "wide angle, f/4", 4, 71.78),
                fitted("cones_fisheye", "fisheye, f/4", 4, 38.04),
            ),
            (fitted_films,),
            theirs="a scene of models by these three lenses at these stops.",
        ),
        Group(
            "Focus test",
            """\
Wide open. Film distances by the thick lens; a ray from the film's centre, sent through the lens at a share of the
rear radius, must cross the axis at the required distance. It does so within 1 % near the axis; what it is off by at
half the radius is spherical aberration, and wide angle and fisheye are not thick lenses even at a tenth.""",
            tuple(focused(metres) for metres in EYES),
            (focus_rays,),
            theirs="objects sharp at the distances that the scene files name.",
        ),
    ),
)
