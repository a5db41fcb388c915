// A ray of the path tracer, and what it meets.
#ifndef HIT_H
#define HIT_H
#include "common/math.h"

#define NEVER        3.0e38f   // farther than any hit, yet finite
#define NO_TRIANGLE  (-1)

typedef struct {
    F3 o, d;
    I  origin;        // the primitive it starts on, NO_PRIMITIVE, or PATH_ENDED
    I  triangle;        // the triangle of it, or NO_TRIANGLE
#if HAS_MOTION
    F  time;        // of its path, since the shutter opens [s]
#endif
} Ray;

typedef struct {
    F t;            // distance
    I primitive;    // or NO_PRIMITIVE
    I triangle;         // the triangle of a mesh, else NO_TRIANGLE
    F b1, b2;       // weights of the triangle's second and third corner; b1 is where along a curve
} Hit;

#endif
