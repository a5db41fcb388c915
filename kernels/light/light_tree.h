// Which of many lamps a light sample goes to: down a tree, at each node to one of four whose lamps, taken together, give
// the point more light by an estimate. One random number leads to a lamp, and the probability of every lamp is known, so that
// paths that meet a lamp by chance are weighed against it. (Conty Estevez and Kulla, «Importance sampling of many lights
// with adaptive tree splitting», 2018; the estimate is from means instead of bounds, which measured 1.5 to 10 times less
// variance.) What shines from infinity stands beside the tree, each by its irradiance.
//
// A node of the tree is eight floats: middle, mean squared distance of the light from it, mean direction where it shines,
// power. Level after level stands in memory: node 1 is the root of a binary tree of which every second level is used, so that
// 4 k to 4 k + 3 are below node k. The leaves have `light_levels` above them, and behind them stand their lamps.
// Four and not two, since estimates one after the other take longer than side by side. Facts: LIGHT_TREE.
#ifndef LIGHT_TREE_H
#define LIGHT_TREE_H
#include "common/transpose.h"
#include "light/emitter.h"

#define LEAST_FACING  0.01f     // so that no lamp is ruled out by an estimate
#define RECEIVER_SOFT 0.01f     // the same of the surface, squared: shading normals and lamps have extent

// A cosine of which only the positive part counts, on average over directions that vary: `spread` is their variance.
IN_PLACE static F facing(F cosine, F spread)
{
    return MAX(0.5f * (cosine + root(cosine * cosine + spread)), (F)(LEAST_FACING));
}

#if LIGHT_LOBES
// What of the light from a direction, or from directions of such a spread about it, a surface scatters along the path, over 1/pi:
// what matte ones would, and the lobe of facets, D of GGX by the angle from the mirrored direction. A node's extent widens that,
// its integral is kept.
IN_PLACE static F with_lobe(F even, Receiver receiver, F3 to, F spread)
{
    F3 off = sub(to, receiver.mirrored);
    F width = receiver.width + 2.0f * spread;
    F rest = width + dot3(off, off);
    return even + receiver.share * (width / (rest * rest) - even);
}
#endif

// About the light of a node's lamps at p, on a surface; 0 for n stands for all directions.
IN_PLACE static F light_of_node(Eight node, F3 p, Receiver receiver)
{
    F3 to = f3(node.f[0] - p.x, node.f[1] - p.y, node.f[2] - p.z);
    F inverse = ONE / MAX(dot3(to, to) + node.f[3], (F)(SMALLEST));
    F per_distance = sqrt(inverse);
    F spread = 0.5f * node.f[3] * inverse;
    F3 axis = f3(node.f[4], node.f[5], node.f[6]);
    F shines = facing(-dot3(axis, to) * per_distance, spread + 0.25f * (1.0f - dot3(axis, axis)));
    F receives = facing(dot3(receiver.n, to) * per_distance, spread + RECEIVER_SOFT);
#if LIGHT_LOBES
    receives = with_lobe(receives, receiver, scale(to, per_distance), spread);
#endif
    return node.f[7] * shines * receives * inverse;
}

static inline F light_of_tree(Scene scene, F3 p, Receiver receiver)
{
    return light_of_node(load_eight(scene.light_nodes, (I)(8)), p, receiver);
}

// The same of an emitter at infinity.
static inline F light_from_afar(Scene scene, int e, Receiver receiver)
{
    const __global Emitter *emitter = scene.emitters + e;
    F light = (F)(emitter->pick);
    F receives = facing(dot3(receiver.n, f3_of(emitter->normal)), (F)(RECEIVER_SOFT));
#if LIGHT_LOBES
    receives = with_lobe(receives, receiver, f3_of(emitter->normal), ZERO);
#endif
    return emitter->kind == EMITTER_ENVIRONMENT ? light : light * receives;
}

static F light_from_all_afar(Scene scene, Receiver receiver)
{
    F sum = ZERO;
    for (int e = scene.environment->lamps; e < scene.emitter_count; ++e)
        sum += light_from_afar(scene, e, receiver);
    return sum;
}

typedef struct { F a, b, c, d, sum; } Four;

// Light of the four nodes below a node.
IN_PLACE static Four light_below(Scene scene, I node, F3 p, Receiver receiver)
{
    Eight a = load_eight(scene.light_nodes, node * 32);
    Eight b = load_eight(scene.light_nodes, node * 32 + 8);
    Eight c = load_eight(scene.light_nodes, node * 32 + 16);
    Eight d = load_eight(scene.light_nodes, node * 32 + 24);
    Four light;
    light.a = light_of_node(a, p, receiver);
    light.b = light_of_node(b, p, receiver);
    light.c = light_of_node(c, p, receiver);
    light.d = light_of_node(d, p, receiver);
    light.sum = (light.a + light.b) + (light.c + light.d);
    return light;
}

static inline I lamp_of_leaf(Scene scene, I leaf)
{
    return AS_I(GATHER(F, scene.light_nodes, leaf + (16 << (2 * scene.environment->light_levels)), ));
}

// Probability that the tree is asked at all: not the emitters at infinity.
static inline F chance_of_tree(Scene scene, F3 p, Receiver receiver)
{
    if (scene.environment->lamps == scene.emitter_count)
        return ONE;
    F near = light_of_tree(scene, p, receiver);
    return near / (near + light_from_all_afar(scene, receiver));
}

// The emitter at infinity of the lanes `open` that u picks among them, and its probability.
static I pick_afar(Scene scene, Receiver receiver, I open, F u, F chance, F *pick)
{
    F left = u * light_from_all_afar(scene, receiver);
    F per_light = chance / light_from_all_afar(scene, receiver);
    I picked = (I)(scene.emitter_count - 1);
    for (int e = scene.environment->lamps; e < scene.emitter_count; ++e) {
        F light = light_from_afar(scene, e, receiver);
        I here = open & ((left < light) | ((I)(e) == scene.emitter_count - 1));
        picked = here ? (I)(e) : picked;
        *pick = here ? light * per_light : *pick;
        left -= light;
        open = open & NOT(here);
    }
    return picked;
}

// The emitter that u picks, and the probability of that.
static I pick_emitter(Scene scene, F3 p, Receiver receiver, F u, F *pick)
{
    F chance = chance_of_tree(scene, p, receiver);
    I afar = u >= chance;
    F distant = ONE;
    I e = FALSE;
    if (ANY(afar))
        e = pick_afar(scene, receiver, afar, rest_of(u, chance, afar, ONE - chance), ONE - chance, &distant);
    u = rest_of(u, chance, FALSE, chance);
    I node = (I)(1);
    for (int level = 0; level < scene.environment->light_levels; ++level) {
        Four light = light_below(scene, node, p, receiver);
        F left = light.a + light.b;
        u *= light.sum;
        I right = (u >= left) & (light.c + light.d > 0.0f);
        u = right ? u - left : u;
        F first = right ? light.c : light.a;
        F other = right ? light.d : light.b;
        I second = (u >= first) & (other > 0.0f);
        F taken = second ? other : first;
        u = rest_of(u, first, second, taken);
        chance *= taken / light.sum;
        node = 4 * node + (right ? (I)(2) : FALSE) + (second ? (I)(1) : FALSE);
    }
    *pick = afar ? distant : chance;
    return afar ? e : lamp_of_leaf(scene, node - (1 << (2 * scene.environment->light_levels)));
}

// Probability with which pick_emitter returns a lamp of the tree.
static F pick_of_lamp(Scene scene, I e, F3 p, Receiver receiver)
{
    I leaf = GATHER(I, scene.emitters, e, .leaf);
    F chance = chance_of_tree(scene, p, receiver);
    I node = (I)(1);
    for (int level = scene.environment->light_levels - 1; level >= 0; --level) {
        Four light = light_below(scene, node, p, receiver);
        I child = (leaf >> (2 * level)) & 3;
        F taken = child >= 2 ? (child == 3 ? light.d : light.c) : (child == 1 ? light.b : light.a);
        chance *= taken > 0.0f ? taken / light.sum : ZERO;
        node = 4 * node + child;
    }
    return chance;
}

// The same of an emitter at infinity.
static inline F pick_of_distant(Scene scene, int e, F3 p, Receiver receiver)
{
    return (ONE - chance_of_tree(scene, p, receiver)) * light_from_afar(scene, e, receiver) / light_from_all_afar(scene, receiver);
}

#endif
