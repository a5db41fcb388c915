// Objects that some rays pass through as if they were not there: Scene.hidden has the rays, sums of HIDDEN_…, by primitive.
#ifndef HIDDEN_H
#define HIDDEN_H
#include "common/scene.h"
#include "geometry/hit.h"

// What a ray is that starts on the primitive `origin`, and one that asks whether something is in the way.
#ifndef KIND_OF_RAY
#define KIND_OF_RAY(T, origin) ((origin) == NO_PRIMITIVE ? (T)(HIDDEN_FROM_CAMERA) : (T)(HIDDEN_FROM_REFLECTION))
#endif
#ifndef KIND_OF_SHADOW
#define KIND_OF_SHADOW HIDDEN_FROM_SHADOW
#endif

// Boundaries of media are there for the ways of paths alone.
#ifndef MEETS_BOUNDARIES
#define UNMET HIDDEN_FROM_ALL_BUT_WAYS
#else
#define UNMET 0
#endif

// Where the lanes of rays of a kind that hit primitive i at t find it: there, or nowhere.
static inline F where_seen(F t, int i, I kind, Scene scene)
{
    return ((kind | UNMET) & scene.hidden[i]) != 0 ? (F)(-1.0f) : t;
}

#if LIGHT_PASSES
// Whether light samples pass a primitive that paths meet.
static inline int lets_light_pass(int i, Scene scene)
{
    return (scene.hidden[i] & ~HIDDEN_FROM_CAMERA) == HIDDEN_FROM_SHADOW;
}

// Lanes of lamps, by their primitives, that light samples alone find.
static inline I hidden_from_paths(I lamp, Scene scene)
{
    return (lamp >= 0) & ((GATHER(I, scene.hidden, MAX(lamp, FALSE), ) & HIDDEN_FROM_REFLECTION) != 0);
}
#endif

#if HAS_MESH
// Whether a triangle, of an instance with that first primitive, is hidden from a ray.
static inline int is_hidden(int triangle, int kind, int first_primitive, Scene scene)
{
    return (scene.hidden[first_primitive + scene.triangles[triangle].w] & (kind | UNMET)) != 0;
}
#endif

#endif
