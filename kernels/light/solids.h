// Lamps with a volume, under any affine map: boxes, ellipsoids, cylinders and cones, sampled about by the solid angle of
// what they show to the shading point. Their outsides alone: what shines inside is left to BSDF sampling, density 0.
//
// All of them are worked out in the frame where the lamp has its canonical shape (geometry/primitives.h). There the map
// takes a unit direction w to one of the world that is |A w| long, and solid angles grow by det A / |A w|^3.
#ifndef SOLIDS_H
#define SOLIDS_H
#include "common/angles.h"
#include "light/emitter.h"

typedef struct {
    F3 x, y, z;                 // axes of the lamp in the world: the columns of A
    F3 row_x, row_y, row_z;     // of the inverse
    F  size;                    // cube root of det A
    F3 centre;                  // origin of the lamp's frame from the shading point, in the world
    F3 o;                       // the shading point in the lamp's frame
} Solid;

static Solid solid_of(const __global Emitter *es, I e, F3 p)
{
    Solid s;
    s.x = THREE_OF_EMITTER(u);
    s.y = THREE_OF_EMITTER(v);
    s.z = THREE_OF_EMITTER(normal);
    s.row_x = THREE_OF_EMITTER(uv);
    s.row_y = THREE_OF_EMITTER(uv_x);
    s.row_z = THREE_OF_EMITTER(uv_y);
    s.size = OF_EMITTER(F, a.w);
    s.centre = sub(THREE_OF_EMITTER(a), p);
    s.o = f3(-dot3(s.row_x, s.centre), -dot3(s.row_y, s.centre), -dot3(s.row_z, s.centre));
    return s;
}

static inline F3 to_world(Solid s, F3 v) { return add(scale(s.x, v.x), add(scale(s.y, v.y), scale(s.z, v.z))); }

static inline F3 to_object(Solid s, F3 d) { return f3(dot3(s.row_x, d), dot3(s.row_y, d), dot3(s.row_z, d)); }

static inline F length3(F3 v) { return sqrt(dot3(v, v)); }

static inline F cubed(F x) { return x * x * x; }

#if EMITTER_BOXES
typedef struct {
    F3 above;       // height of the point above the plane of the face of each axis that looks at it; 0: none does
    F3 share;       // 1 / cubed distance of the middle of that face; relative to that of the box
    F  total;       // of above * share, which is about the solid angle of each face: its area * height is 4 det A * above
} Faces;

static inline F face_share(Solid s, F3 axis, F side)
{
    F3 middle = along(s.centre, axis, with_sign(ONE, side));
    return cubed(sqrt(dot3(s.centre, s.centre) / MAX(dot3(middle, middle), (F)(SMALLEST))));
}

static inline Faces faces_of(Solid s)
{
    Faces f;
    f.above = f3(MAX(absolute(s.o.x) - 1.0f, ZERO), MAX(absolute(s.o.y) - 1.0f, ZERO), MAX(absolute(s.o.z) - 1.0f, ZERO));
    f.share = f3(face_share(s, s.x, s.o.x), face_share(s, s.y, s.o.y), face_share(s, s.z, s.o.z));
    f.total = dot3(f.above, f.share);
    return f;
}

// Density of a point at a distance on a face: its pick, by area.
static inline F face_pdf(Solid s, Faces f, F share, F distance)
{
    F relative = distance / s.size;
    return f.total > 0.0f ? relative * relative * share * (relative / (4.0f * f.total)) : ZERO;
}

static inline F box_pdf(Solid s, F3 d, F t)
{
    Faces f = faces_of(s);
    F3 w = to_object(s, d);
    F x = f.above.x / MAX(absolute(w.x), (F)(SMALLEST));      // the face that the ray meets last lets it in
    F y = f.above.y / MAX(absolute(w.y), (F)(SMALLEST));
    F z = f.above.z / MAX(absolute(w.z), (F)(SMALLEST));
    F share = ((x >= y) & (x >= z)) ? f.share.x : (y >= z ? f.share.y : f.share.z);
    return face_pdf(s, f, share, t);
}

static F3 sample_box(Solid s, F u, F v, F *pdf)
{
    Faces f = faces_of(s);
    F pick = u * f.total;
    F of_x = f.above.x * f.share.x;
    F of_y = f.above.y * f.share.y;
    F of_z = f.above.z * f.share.z;
    I on_x = pick < of_x;
    I on_y = NOT(on_x) & ((pick - of_x < of_y) | (of_z <= 0.0f));
    F chosen = on_x ? of_x : (on_y ? of_y : of_z);
    F start = on_x ? ZERO : (on_y ? of_x : of_x + of_y);
    F a = 2.0f * MIN(MAX((pick - start) / MAX(chosen, (F)(SMALLEST)), ZERO), ONE) - 1.0f;
    F b = 2.0f * v - 1.0f;
    F3 q = f3(on_x ? with_sign(ONE, s.o.x) : a, on_x ? a : (on_y ? with_sign(ONE, s.o.y) : b),
              (on_x | on_y) ? b : with_sign(ONE, s.o.z));
    F3 to = to_world(s, sub(q, s.o));
    *pdf = face_pdf(s, f, on_x ? f.share.x : (on_y ? f.share.y : f.share.z), length3(to));
    *pdf = chosen > 0.0f ? *pdf : ZERO;
    return to;
}
#endif

#if EMITTER_ELLIPSOIDS
// Directions are even over the cone of the unit sphere.
static inline F ball_pdf(Solid s, F stretch)
{
    F sin2 = ONE / MAX(dot3(s.o, s.o), (F)(SMALLEST));
    return sin2 < 1.0f ? cubed(stretch) * (1.0f + root(1.0f - sin2)) / (2.0f * PI_F * sin2) : ZERO;
}

static inline F ellipsoid_pdf(Solid s, F3 d)
{
    return ball_pdf(s, ONE / (s.size * length3(to_object(s, d))));
}

static F3 sample_ellipsoid(Solid s, F u, F v, F *pdf)
{
    F d2 = dot3(s.o, s.o);
    F distance = sqrt(d2);
    F sin2_max = MIN(ONE / MAX(d2, (F)(SMALLEST)), ONE);
    F versine = sin2_max * u / (1.0f + root(1.0f - sin2_max));      // 1 - cos of the sampled angle
    F sin2 = versine * (2.0f - versine);
    F sn, cs;
    sincos_turns(v, &sn, &cs);
    F sine = root(sin2);
    F3 axis = scale(s.o, -ONE / MAX(distance, (F)(SMALLEST)));
    F3 tx, ty;
    frame(axis, &tx, &ty);
    F3 stretched = to_world(s, from_frame(tx, ty, axis, f3(sine * cs, sine * sn, 1.0f - versine)));
    *pdf = ball_pdf(s, length3(stretched) / s.size);
    return scale(stretched, distance * (1.0f - versine) - root(1.0f - d2 * sin2));
}
#endif

#if EMITTER_CYLINDERS
// A line of a cylinder along its axis: seen from the point in a direction of the lamp's x and y. With t the way along the line
// in units of the distance to it, from its foot, the solid angle of a piece is proportional to sin(atan(t)).
typedef struct {
    F beside;       // distance to the line, in the lamp's x and y
    F foot;         // of the perpendicular from the point, as z
    F unit;         // z of a step of t
    F start, end;   // t of the ends of the line
    F span;         // sin(atan(end)) - sin(atan(start))
    F density;      // of directions, for even angles in x and y and even sines along the line
} TubeLine;

static inline F tube_half_angle(F rho2) { return turns_of(root(rho2 - 1.0f), ONE); }       // of the silhouette [turns]

static TubeLine tube_line(Solid s, F hx, F hy)
{
    TubeLine line;
    F across = s.o.x * hy - s.o.y * hx;
    line.beside = MAX(-(s.o.x * hx + s.o.y * hy) - root(1.0f - across * across), (F)(1e-12f));
    F3 there = add(scale(s.x, hx), scale(s.y, hy));
    F z2 = dot3(s.z, s.z);
    F z = sqrt(z2);
    F3 normal = sub(scale(s.row_x, hy), scale(s.row_y, hx));        // (there x axis) / det A
    F slope = s.size * length3(normal);
    F relative = s.size / z;
    line.foot = s.o.z - line.beside * dot3(there, s.z) / z2;
    line.unit = line.beside * slope * relative * relative;
    line.start = MAX((ZERO - line.foot) / line.unit, (F)(-1e9f));
    line.end = MIN((ONE - line.foot) / line.unit, (F)(1e9f));
    F q0 = sqrt(1.0f + line.start * line.start);
    F q1 = sqrt(1.0f + line.end * line.end);
    // Of the same sign the sines are nearly equal, and their difference is that of the ends.
    F same = (line.start + line.end) / (q0 * q1 * (line.start * q1 + line.end * q0)) / line.unit;
    line.span = line.start * line.end > 0.0f ? same : line.end / q1 - line.start / q0;
    F angle = 4.0f * PI_F * tube_half_angle(s.o.x * s.o.x + s.o.y * s.o.y);
    line.density = slope * slope * relative / (angle * line.span);
    return line;
}

// t of the point that u chooses: of the ends on one side by 1 - sine, which keeps its digits there.
static F along_tube(TubeLine line, F u)
{
    I behind = line.end <= 0.0f;
    F near = behind ? -line.end : line.start;
    F far = behind ? -line.start : line.end;
    F q = sqrt(1.0f + near * near);
    F versine = (near > 0.0f ? ONE / (q * (q + near)) : 1.0f - near / q) - (behind ? 1.0f - u : u) * line.span;
    versine = MAX(versine, (F)(1e-18f));
    F t = (1.0f - versine) / sqrt(versine * (2.0f - versine));
    t = MIN(MAX(t, near), far);
    return behind ? -t : t;
}

static inline F cylinder_pdf(Solid s, F3 d, F t)
{
    F3 w = to_object(s, d);
    F x = s.o.x + t * w.x;
    F y = s.o.y + t * w.y;
    F in_plane = ONE / MAX(sqrt(w.x * w.x + w.y * w.y), (F)(SMALLEST));
    I outside = (s.o.x * s.o.x + s.o.y * s.o.y > 1.0f) & (x * w.x + y * w.y < 0.0f);
    F pdf = tube_line(s, w.x * in_plane, w.y * in_plane).density;
    return (outside & (pdf > 0.0f) & (pdf < NEVER)) ? pdf : ZERO;
}

static F3 sample_cylinder(Solid s, F u, F v, F *pdf)
{
    F rho2 = s.o.x * s.o.x + s.o.y * s.o.y;
    F inverse = ONE / sqrt(MAX(rho2, ONE));
    F side = 2.0f * u - 1.0f;
    F sn, cs;
    sincos_turns(absolute(side) * tube_half_angle(MAX(rho2, ONE)), &sn, &cs);
    sn = with_sign(sn, side);
    F hx = -(s.o.x * cs - s.o.y * sn) * inverse;
    F hy = -(s.o.x * sn + s.o.y * cs) * inverse;
    TubeLine line = tube_line(s, hx, hy);
    F z = line.foot + along_tube(line, v) * line.unit - s.o.z;
    *pdf = ((rho2 > 1.0f) & (line.density > 0.0f) & (line.density < NEVER)) ? line.density : ZERO;
    return to_world(s, f3(line.beside * hx, line.beside * hy, z));
}
#endif

#if EMITTER_CONES
// The generators of a cone that look at the point are those within an angle of its own; they are chosen by a parabola,
// which is about what they show, and the point on them by area.
typedef struct {
    F rho, depth;   // distance of the point from the axis, and below the apex
    F ex, ey;       // the direction of the point from the axis
    F widest;       // angle of the visible generators on either side [turns]; 0: none
    I all;
} Generators;

static Generators generators_of(Solid s)
{
    Generators g;
    g.rho = sqrt(s.o.x * s.o.x + s.o.y * s.o.y);
    g.depth = 1.0f - s.o.z;
    I beside = g.rho > SMALLEST;
    g.ex = beside ? s.o.x / g.rho : ONE;
    g.ey = beside ? s.o.y / g.rho : ZERO;
    g.all = g.depth <= -g.rho;
    g.widest = g.all ? (F)(0.5f) : (g.depth < g.rho ? turns_of(g.depth, root((g.rho - g.depth) * (g.rho + g.depth))) : ZERO);
    return g;
}

// `x` is the share of `widest`, `shown` how much the generator turns to the point, `distance` that of the point on it.
static inline F generator_pdf(Solid s, Generators g, F x, F shown, F distance)
{
    F parabola = g.all ? ONE : 1.5f * (1.0f - x * x);
    F relative = distance / s.size;
    F pdf = parabola * relative * relative * (relative / (2.0f * PI_F * g.widest * shown));
    return ((g.widest > 0.0f) & (shown > 0.0f) & (pdf > 0.0f) & (pdf < NEVER)) ? pdf : ZERO;
}

static inline F cone_pdf(Solid s, F3 d, F t)
{
    Generators g = generators_of(s);
    F3 w = to_object(s, d);
    F x = s.o.x + t * w.x;
    F y = s.o.y + t * w.y;
    F radius = MAX(sqrt(x * x + y * y), (F)(SMALLEST));
    F shown = -t * ((x * w.x + y * w.y) / radius + w.z);
    F turns = absolute(turns_of(x * g.ex + y * g.ey, y * g.ex - x * g.ey));
    return generator_pdf(s, g, MIN(turns / MAX(g.widest, (F)(SMALLEST)), ONE), shown, t);
}

static F3 sample_cone(Solid s, F u, F v, F *pdf)
{
    Generators g = generators_of(s);
    F side = 2.0f * u - 1.0f;
    F size = absolute(side);
    F sn, cs;
    // (3 x - x^3) / 2 = size: x is twice the sine of a third of an angle.
    sincos_turns(turns_of(root((1.0f - size) * (1.0f + size)), size) * (1.0f / 3.0f), &sn, &cs);
    F x = g.all ? size : MIN(2.0f * sn, ONE);
    sincos_turns(x * g.widest, &sn, &cs);
    F shown = g.rho * cs - g.depth;
    sn = with_sign(sn, side);
    F radius = sqrt(v);
    F3 q = f3(radius * (g.ex * cs - g.ey * sn), radius * (g.ey * cs + g.ex * sn), 1.0f - radius);
    F3 to = to_world(s, sub(q, s.o));
    *pdf = generator_pdf(s, g, x, shown, length3(to));
    return to;
}
#endif

// Density of the direction d, which met the lamp at distance t.
static inline F solid_pdf(const __global Emitter *es, I e, I kind, F3 p, F3 d, F t)
{
    Solid s = solid_of(es, e, p);
    F pdf = ZERO;
#if EMITTER_BOXES
    pdf = kind == EMITTER_BOX ? box_pdf(s, d, t) : pdf;
#endif
#if EMITTER_ELLIPSOIDS
    pdf = kind == EMITTER_ELLIPSOID ? ellipsoid_pdf(s, d) : pdf;
#endif
#if EMITTER_CYLINDERS
    pdf = kind == EMITTER_CYLINDER ? cylinder_pdf(s, d, t) : pdf;
#endif
#if EMITTER_CONES
    pdf = kind == EMITTER_CONE ? cone_pdf(s, d, t) : pdf;
#endif
    return pdf;
}

// The way from p to a point of the lamp that it sees, and the density of its direction; 0: it sees none.
static F3 sample_solid(const __global Emitter *es, I e, I kind, F3 p, F u, F v, F *pdf)
{
    Solid s = solid_of(es, e, p);
    F3 to = s.centre;
    F density;
    *pdf = ZERO;
#define SAMPLE_SOLIDS(KIND, sample)                         \
    {                                                       \
        I mine = kind == KIND;                              \
        if (ANY(mine)) {                                    \
            to = select3(mine, sample(s, u, v, &density), to);      \
            *pdf = mine ? density : *pdf;                   \
        }                                                   \
    }
#if EMITTER_BOXES
    SAMPLE_SOLIDS(EMITTER_BOX, sample_box)
#endif
#if EMITTER_ELLIPSOIDS
    SAMPLE_SOLIDS(EMITTER_ELLIPSOID, sample_ellipsoid)
#endif
#if EMITTER_CYLINDERS
    SAMPLE_SOLIDS(EMITTER_CYLINDER, sample_cylinder)
#endif
#if EMITTER_CONES
    SAMPLE_SOLIDS(EMITTER_CONE, sample_cone)
#endif
    return to;
}

#endif
