// The BSDFs behind one interface, evaluated under masks; materials that the scene lacks are not compiled.
// `d` is the direction of the arriving camera path (towards the surface), `wo` the direction on.
#ifndef SCATTER_H
#define SCATTER_H
#include "common/exponential.h"
#include "material/fresnel.h"
#include "material/side.h"
#if HAS_PLASTIC
#include "material/plastic.h"
#endif
#if HAS_GLOSSY
#include "material/glossy.h"
#endif
#if HAS_THIN_GLASS
#include "material/thin_glass.h"
#endif

typedef struct {
    F3 direction;
    F3 weight;   // BSDF * cosine / density
    F  pdf;      // solid-angle density; 0 where light sampling cannot compete (mirror, smooth glass)
} Scattered;

#if HAS_GLOSSY
static I is_glossy(Vertex vertex)
{
    I glossy = FALSE;
#if HAS_CONDUCTOR
    glossy = glossy | (vertex.kind == MATERIAL_CONDUCTOR);
#endif
#if HAS_METAL
    glossy = glossy | (vertex.kind == MATERIAL_METAL);
#endif
#if HAS_ROUGH_DIELECTRIC
    glossy = glossy | (vertex.kind == MATERIAL_ROUGH_DIELECTRIC);
#endif
#if HAS_ROUGH_PLASTIC
    glossy = glossy | (vertex.kind == MATERIAL_ROUGH_PLASTIC);
#endif
#if HAS_PRINCIPLED
    glossy = glossy | (vertex.kind == MATERIAL_PRINCIPLED);
#endif
    return glossy;
}

// The frame of the facets: x along the tangent where a material is brushed.
static void facet_frame(Vertex vertex, F3 n, F3 *s, F3 *t)
{
#if HAS_ANISOTROPY
    F3 flat = along(vertex.tangent, n, -dot3(vertex.tangent, n));
    F length2 = dot3(flat, flat);
    frame(n, s, t);
    *s = select3(length2 > 0.0f, scale(flat, 1.0f / sqrt(MAX(length2, (F)(SMALLEST)))), *s);
    *t = cross3(n, *s);
#else
    frame(n, s, t);
#endif
}
#endif

// BSDF * cosine, and the density with which scatter_sample would choose `wo`.
static F3 scatter_eval(Vertex vertex, F3 d, F3 wo, F *pdf)
{
    Side side = side_of(vertex, d);
    F cos_o = dot3(side.n, wo);
    F3 value = f3(ZERO, ZERO, ZERO);
    *pdf = ZERO;
#if HAS_MATTE
    I matte = (vertex.kind == MATERIAL_MATTE) & (cos_o > 0.0f);
    F even = matte ? cos_o * INV_PI_F : ZERO;
    value = scale(vertex.color, even);
    *pdf = even;
#endif
#if HAS_PLASTIC
    I plastic = (vertex.kind == MATERIAL_PLASTIC) & (cos_o > 0.0f);
    if (ANY(plastic)) {
        Plastic of = plastic_of(vertex, side.cosine);
        value = select3(plastic, plastic_light(vertex, of, MAX(cos_o, ZERO)), value);
        *pdf = plastic ? (1.0f - of.mirror) * INV_PI_F * cos_o : *pdf;
    }
#endif
#if HAS_GLOSSY
    I glossy = is_glossy(vertex);
    if (ANY(glossy)) {
        F3 s, t;
        facet_frame(vertex, side.n, &s, &t);
        F3 wi = scale(to_frame(s, t, side.n, d), -ONE);
        wi.z = side.cosine;
        F density;
        F3 bsdf = glossy_eval(vertex, wi, to_frame(s, t, side.n, wo), side.behind, &density);
        value = select3(glossy, bsdf, value);
        *pdf = glossy ? density : *pdf;
    }
#endif
#if HAS_SHADING_NORMAL
    I agrees = consistent(vertex, side, wo);
    value = keep3(agrees, value);
    *pdf = agrees ? *pdf : ZERO;
#endif
    return value;
}

static Scattered scatter_sample(Vertex vertex, F3 d, F u, F v, F lobe)
{
    Side side = side_of(vertex, d);
    F3 n = side.n;
#if HAS_MIX
    lobe = vertex.lobe;
#endif
    Scattered out;
    out.direction = n;
    out.weight = vertex.color;
    out.pdf = ZERO;
#if HAS_MATTE || HAS_PLASTIC || HAS_GLOSSY
    F3 s, t;
#if HAS_GLOSSY
    facet_frame(vertex, n, &s, &t);
#else
    frame(n, &s, &t);
#endif
#endif
#if HAS_MATTE || HAS_PLASTIC
    I diffuse = FALSE;
#if HAS_MATTE
    diffuse = vertex.kind == MATERIAL_MATTE;
#endif
#if HAS_PLASTIC
    I plastic = vertex.kind == MATERIAL_PLASTIC;
    Plastic of;
    I coat = FALSE;
    if (ANY(plastic)) {
        of = plastic_of(vertex, side.cosine);
        coat = plastic & (lobe < of.mirror);
        diffuse = diffuse | (plastic & NOT(coat));
        F weight = of.reflects / of.mirror;
        out.weight = select3(coat, f3(weight, weight, weight), out.weight);
    }
#endif
    if (ANY(diffuse)) {
        F sn, cs;
        sincos_turns(u, &sn, &cs);
        F r = sqrt(v);
        F z = root(1.0f - v);
        F3 wo = from_frame(s, t, n, f3(r * cs, r * sn, z));
        out.direction = select3(diffuse, wo, out.direction);
        out.pdf = diffuse ? z * INV_PI_F : out.pdf;
#if HAS_PLASTIC
        I base = plastic & diffuse;
        if (ANY(base)) {
            F density = (1.0f - of.mirror) * INV_PI_F * z;
            out.weight = select3(base, scale(plastic_light(vertex, of, z), 1.0f / density), out.weight);
            out.pdf = base ? density : out.pdf;
        }
#endif
        out.weight = select3(diffuse & (z <= 0.0f), f3(ZERO, ZERO, ZERO), out.weight);
    }
#endif
#if HAS_MIRROR || HAS_PLASTIC
    I mirror = FALSE;
#if HAS_MIRROR
    mirror = vertex.kind == MATERIAL_MIRROR;
#endif
#if HAS_PLASTIC
    mirror = mirror | coat;
#endif
    if (ANY(mirror))
        out.direction = select3(mirror, normalized(along(d, n, 2.0f * side.cosine)), out.direction);
#endif
#if HAS_GLOSSY
    I glossy = is_glossy(vertex);
    if (ANY(glossy)) {
        F3 wi = scale(to_frame(s, t, n, d), -ONE);
        wi.z = side.cosine;
        F3 wo;
        F density;
        F3 weight = glossy_sample(vertex, wi, side.behind, u, v, lobe, &wo, &density);
        out.direction = select3(glossy & (density > 0.0f), from_frame(s, t, n, wo), out.direction);
        out.weight = select3(glossy, weight, out.weight);
        out.pdf = glossy ? density : out.pdf;
    }
#endif
#if HAS_DIELECTRIC
    I glass = vertex.kind == MATERIAL_DIELECTRIC;
    if (ANY(glass)) {
        F index = vertex.parameter;
        F eta = side.behind ? ONE / index : index;
        F ci = side.cosine;
        F ct;
        F reflectance = fresnel(ci, eta, &ct);
        I reflects = lobe < reflectance;
        F inverse = ONE / eta;
        F3 reflected = along(d, n, 2.0f * ci);
        F3 refracted = along(scale(d, inverse), n, inverse * ci - ct);
        out.direction = select3(glass, normalized(select3(reflects, reflected, refracted)), out.direction);
        F squeeze = reflects ? ONE : inverse * inverse;       // radiance over n^2 is what refraction conserves
        out.weight = select3(glass, f3(squeeze, squeeze, squeeze), out.weight);
    }
#endif
#if HAS_THIN_GLASS
    I thin = vertex.kind == MATERIAL_THIN_GLASS;
    if (ANY(thin)) {
        Pane pane = pane_of(side.cosine, vertex.parameter, vertex.closure.depth);
        F back = max3(pane.reflected);
        F share = back / (back + max3(pane.passed));
        I reflects = lobe < share;
        F3 way = select3(reflects, along(d, n, 2.0f * side.cosine), d);
        F3 weight = select3(reflects, scale(pane.reflected, 1.0f / share), scale(pane.passed, 1.0f / (1.0f - share)));
        out.direction = select3(thin, normalized(way), out.direction);
        out.weight = select3(thin, mul(vertex.color, weight), out.weight);
    }
#endif
#if HAS_SHADING_NORMAL
    I agrees = consistent(vertex, side, out.direction);
    out.weight = keep3(agrees, out.weight);
#endif
    return out;
}

#endif
