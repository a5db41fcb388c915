// Bumps: the shading normal of a surface that heights of a texture would make (Blinn 1978), whose outline stays as it is.
#ifndef BUMP_H
#define BUMP_H
#include "geometry/tangent.h"
#include "material/texture.h"

#if HAS_BUMP
#define BUMP_STEP 1.953125e-3f      // of patterns without texels: 2^-9, so that places and their differences stay exact

// Heights are the first channel; those of noise go on beyond its two colours.
static F pattern_height(const __global Texture *t, F3 at, Scene scene)
{
#if HAS_PERLIN
    if (t->kind == TEXTURE_PERLIN)
        return t->a.x + (t->b.x - t->a.x) * pattern_at(t, at.x, at.y, at.z, scene.texels);
#endif
    return pattern_color(t, at.x, at.y, at.z, scene.texels).x;
}

static F slope_along(const __global Texture *t, F3 at, float x, float y, Scene scene)
{
    F3 before = f3(at.x - x, at.y - y, at.z), after = f3(at.x + x, at.y + y, at.z);
    return (pattern_height(t, after, scene) - pattern_height(t, before, scene)) * (0.5f / (x + y));
}

#if HAS_MAPPING
static inline float stretch_of(float4 row) { return sqrt(row.x * row.x + row.y * row.y + row.z * row.z); }

// The slope along a direction of the world of a texture that lies in space.
static F slope_in_space(const __global Texture *t, F3 direction, float step, Scene scene)
{
    Scene before = scene, after = scene;
    before.place = along(scene.place, direction, (F)(-step));
    after.place = along(scene.place, direction, (F)(step));
    F rise = pattern_height(t, pattern_point(t, ZERO, ZERO, after), after)
           - pattern_height(t, pattern_point(t, ZERO, ZERO, before), before);
    return rise * (0.5f / step);
}
#endif

// The slope of a pattern's heights on the surface: by how much they grow per metre, along where they grow most. Derivatives are
// central differences, of pictures over one texel: between the centres of texels they change evenly.
static F3 pattern_slope(const __global Texture *t, int lengths, SurfacePoint point, F3 n, Scene scene)
{
    F3 x, y;
#if HAS_MAPPING
    if (t->mapping != MAPPED_UV) {
        float4 flat_u = t->row_u, flat_v = t->row_v;
        flat_u.z = 0.0f;
        flat_v.z = 0.0f;
        float most = MAX(MAX(stretch_of(t->row_x), stretch_of(t->row_y)), stretch_of(t->row_z));
        float step = BUMP_STEP / (most * MAX(MAX(stretch_of(flat_u), stretch_of(flat_v)), 1e-6f));
        frame(n, &x, &y);
        return along(scale(x, slope_in_space(t, x, step, scene)), y, slope_in_space(t, y, step, scene));
    }
#endif
    float step_x = BUMP_STEP, step_y = BUMP_STEP;
#if HAS_IMAGE
    if (t->kind == TEXTURE_IMAGE) {
        step_x = 0.5f / (float)t->width;
        step_y = 0.5f / (float)t->height;
    }
#endif
    F3 at = pattern_point(t, point.u, point.v, scene);
    F by_x = slope_along(t, at, step_x, 0.0f, scene), by_y = slope_along(t, at, 0.0f, step_y, scene);
    F by_u = by_x * t->row_u.x + by_y * t->row_v.x, by_v = by_x * t->row_u.y + by_y * t->row_v.y;
    // Each derivative counts along the normal, within the surface, of the other's direction.
    F3 lean_u = cross3(point.bitangent, n), lean_v = cross3(n, point.tangent);
    F area = dot3(point.tangent, lean_u);
    I known = absolute(area) > SMALLEST;
    F share = ONE / (known ? area : ONE);
    if (lengths != BUMP_SURFACE) {
        share = lengths == BUMP_U ? ONE / sqrt(MAX(dot3(lean_v, lean_v), (F)(SMALLEST))) : ONE;
        tangent_frame(point, &lean_u, &lean_v);
    }
    return keep3(known, scale(along(scale(lean_u, by_u), lean_v, by_v), share));
}

// The same of any texture: a mixture has the slopes of its parts by the rule of products.
static F3 height_slope(int texture, int lengths, SurfacePoint point, F3 n, Scene scene)
{
    const __global Texture *t = scene.textures + texture;
#if HAS_MIXTURE
    if (t->kind == TEXTURE_MIXTURE) {
        F height[MIXTURE_HELD];
        F3 slope[MIXTURE_HELD];
        int count = 0;
        for (int i = (int)t->first; i <= texture; ++i) {
            const __global Texture *each = scene.textures + i;
            if (each->kind == TEXTURE_MIXTURE) {
                count -= 2;
                int a = count - 1, b = count, k = count + 1;
                slope[a] = along(along(scale(slope[a], ONE - height[k]), slope[b], height[k]), slope[k], height[b] - height[a]);
                height[a] += height[k] * (height[b] - height[a]);
            } else {
                height[count] = pattern_height(each, pattern_point(each, point.u, point.v, scene), scene);
                slope[count++] = pattern_slope(each, lengths, point, n, scene);
            }
        }
        return slope[0];
    }
#endif
    return pattern_slope(t, lengths, point, n, scene);
}

static F3 bumped_normal(const __global Material *material, SurfacePoint point, F3 n, Scene scene)
{
    F3 slope = height_slope(material->bump_texture, material->bump_lengths, point, n, scene);
    return normalized(along(n, slope, (F)(-material->bump_height)));
}
#endif

#endif
