// A point of a surface that a ray hit.
#ifndef SURFACE_POINT_STRUCT_H
#define SURFACE_POINT_STRUCT_H
#include "common/math.h"

#define ROUNDING 6.0e-8f      // of one operation

typedef struct {
    F3 p;           // position
    F3 n, ng;       // outward unit normals: for shading, and of the surface itself
#if HAS_TANGENT
    F3 tangent;     // dp/du, of any length
#endif
#if HAS_BITANGENT
    F3 bitangent;   // dp/dv, of any length
#endif
    F  u, v;        // texture coordinates
    F  offset;      // along ng, beyond which a ray that starts at p cannot meet this surface again by rounding; a
                    // primitive that knows its roots needs none
} SurfacePoint;

#endif
