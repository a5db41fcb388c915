// Smooths a picture by one step of a wavelet with holes, joint bilateral on albedo, normal, position and luminance: a pixel takes of
// the eight others `step` away what lies on the same surface and differs by less than the noise does. Light and albedo are summed
// apart, as the mean of their product is not the product of their means. The first of the steps, FIRST, measures the noise among
// twelve neighbours and cuts off what stands out of it. Where both pixels are blurred by more than they lie apart, surfaces count no
// more. The last step, LAST, writes the picture. Dammertz et al., HPG 2010; variance as in Schied et al., HPG 2017. A work item does VW pixels of a row.
#include "common/math.h"

#if VW == 1
#define TAKE(p, i)     ((p)[i])
#define PUT(p, i, v)   ((p)[i] = (v))
#elif VW == 8
#define TAKE(p, i)     vload8(0, (p) + (i))
#define PUT(p, i, v)   vstore8(v, 0, (p) + (i))
#else
#define TAKE(p, i)     vload16(0, (p) + (i))
#define PUT(p, i, v)   vstore16(v, 0, (p) + (i))
#endif
#define PLANE(p, k)    ((p) + (k) * (size_t)plane)
#define TAKE3(p, i)    f3(TAKE(p, i), TAKE(PLANE(p, 1), i), TAKE(PLANE(p, 2), i))
#define PUT3(p, i, v)  PUT(p, i, v.x); PUT(PLANE(p, 1), i, v.y); PUT(PLANE(p, 2), i, v.z)

#define OTHER_ALBEDO  3.0f     // 1 / squared distance of colours that do not mix
#define OFF_PLANE     0.004f   // of the distance, per pixel: how far from the tangent plane a neighbour may lie
#define STANDS_OUT    3.0f     // standard deviations of the neighbours
#define ALIKE         12.0f     // standard deviations from which on light is of another kind
#define REACH         (1 + FIRST)

static inline F brightness(F3 light, F3 albedo)
{
    F sum = 0.2126f * light.x + 0.7152f * light.y + 0.0722f * light.z;
    return sum / MAX(0.2126f * albedo.x + 0.7152f * albedo.y + 0.0722f * albedo.z, (F)(1e-9f));
}
static inline F falling(F x) { F left = MAX(ONE - x, ZERO); return left * left; }

__kernel void denoise(__global const float *guides,   // as the kernel of that name writes them
                      __global const float *light,    // picture, albedo by weight, albedo of what is blurred, variance, weight
                      __global float       *out,      // the same; of LAST the picture, [height][width][3]
                      uint4                 sizes,    // width, height, pixels from row to row, margin
                      uint                  plane,    // pixels of a plane
                      int                   step)     // between the pixels [pixels]
{
    uint items = (sizes.x + VW - 1) / VW, y = get_global_id(0) / items;
    if (y >= sizes.y)
        return;
    int row = (int)sizes.z, at = (int)((y + sizes.w) * sizes.z + sizes.w + get_global_id(0) % items * VW);
    F3 albedo = TAKE3(guides, at), normal = TAKE3(PLANE(guides, 3), at), position = TAKE3(PLANE(guides, 6), at);
    F blur = TAKE(PLANE(guides, 9), at);
    F from = dot3(normal, position);
    F closeness = ONE / MAX(OFF_PLANE * (float)step * sqrt(dot3(position, position)), (F)(1e-12f));
    I bare = dot3(normal, normal) == 0.0f;                // where nothing is met
    F3 sum = TAKE3(light, at), whole = TAKE3(PLANE(light, 3), at), tint = TAKE3(PLANE(light, 6), at);
    F bright = brightness(sum, whole), passes = TAKE(PLANE(light, 10), at), all = ONE;
    I dark = whole.x <= 0.0f;                             // no ray has come through the lens
#if FIRST
    F sums = ZERO, squares = ZERO, weights = ZERO;
#else
    F variance = ZERO;
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i)
            variance += (float)((2 - abs(i)) * (2 - abs(j))) / 16.0f * TAKE(PLANE(light, 9), at + j * row + i);
    F per_deviation = ONE / (ALIKE * sqrt(MAX(variance, ZERO)) + 1e-3f * bright + 1e-9f);
    F spread = TAKE(PLANE(light, 9), at), weights = ONE;
#if TINTED
    F tints = ONE;
#endif
#endif
    for (int j = -REACH; j <= REACH; ++j) {
        for (int i = -REACH; i <= REACH; ++i) {
            if ((i == 0 && j == 0) || ((i + j) & FIRST))   // of the 24 of the first step every second one
                continue;
            int to = at + step * (j * row + i);
            F there = TAKE(PLANE(guides, 10), to);
            F3 colour = sub(TAKE3(guides, to), albedo);
            F facing = MAX(dot3(TAKE3(PLANE(guides, 3), to), normal), ZERO);
            facing = facing * facing;
            facing = facing * facing;
            facing = bare ? ONE : facing * facing;
            F off = absolute(dot3(normal, TAKE3(PLANE(guides, 6), to)) - from) * closeness;
            F same = facing * falling(off) * falling(OTHER_ALBEDO * dot3(colour, colour));
            float apart = step * (abs(i) > abs(j) ? abs(i) : abs(j));
            F blurred = MIN(MAX(MIN(blur, TAKE(PLANE(guides, 9), to)) / apart - 0.5f, ZERO), ONE);
            same = there * (same + blurred * (ONE - same));
            F3 other = TAKE3(light, to), theirs = TAKE3(PLANE(light, 3), to);
            F their = brightness(other, theirs);
            F across = there * TAKE(PLANE(guides, 10), at - step * (j * row + i));   // of both sides, as it may slope
            passes += across * TAKE(PLANE(light, 10), to);
            all += across;
            same = theirs.x > 0.0f ? same : ZERO;
#if FIRST
            sums += same * their;
            squares += same * their * their;
            weights += same;
#else
            F weight = same * (dark ? ONE : falling(absolute(their - bright) * per_deviation));
            spread += weight * weight * TAKE(PLANE(light, 9), to);
            sum = add(sum, scale(other, weight));
            whole = add(whole, scale(theirs, weight));
            weights += weight;
#if TINTED
            blurred = blurred * there;
            tint = add(tint, scale(TAKE3(PLANE(light, 6), to), blurred));
            tints += blurred;
#endif
#endif
        }
    }
#if FIRST
    F share = ONE / MAX(weights, (F)(1e-9f)), mean = sums * share;
    F spread = MAX(squares * share - mean * mean, ZERO), most = mean + STANDS_OUT * sqrt(spread);
    sum = scale(sum, ((weights > 1.0f) & (bright > most)) ? most / bright : ONE);
    // Without neighbours on the same surface nothing is known of the noise: it may be as large as the light.
    spread = weights > 1.0f ? spread : bright * bright;
#else
    F share = ONE / weights;
    sum = scale(sum, share);
    whole = scale(whole, share);
    spread = spread * share * share;
#if TINTED
    tint = scale(tint, ONE / tints);
#endif
#endif
    passes = passes / all;
#if LAST
    tint = scale(tint, passes);
    F3 seen = f3(sum.x / MAX(whole.x, (F)(1e-9f)) * tint.x, sum.y / MAX(whole.y, (F)(1e-9f)) * tint.y,
                 sum.z / MAX(whole.z, (F)(1e-9f)) * tint.z);
    uint x = get_global_id(0) % items * VW;
    __global float *pixel = out + 3 * (y * sizes.x + x);
    for (uint lane = 0; lane < VW && x + lane < sizes.x; ++lane) {
        pixel[3 * lane] = ((float *)&seen.x)[lane];
        pixel[3 * lane + 1] = ((float *)&seen.y)[lane];
        pixel[3 * lane + 2] = ((float *)&seen.z)[lane];
    }
#else
    PUT3(out, at, sum);
    PUT3(PLANE(out, 3), at, whole);
    PUT3(PLANE(out, 6), at, tint);
    PUT(PLANE(out, 9), at, spread);
    PUT(PLANE(out, 10), at, passes);
#endif
}
