// Readies a picture for denoise: takes what the layers say of each pixel out of the tiles of the film, to planes of rows with
// margins, where guides are 0. A work item does four pixels of a row, which lie side by side in a tile.
#define TILE         8
#define QUARTER      4
#define LEAST_ALBEDO 0.1f    // so that the light that falls on black things stays finite
#define GLARE        4.0f    // times white, from which on to twice as much it is a lamp that is seen, without an albedo

// Pixels around one, the nearest first.
__constant int2 NEAR[24] = {
    (int2)(1, 0), (int2)(-1, 0), (int2)(0, 1), (int2)(0, -1), (int2)(1, 1), (int2)(-1, -1), (int2)(1, -1), (int2)(-1, 1),
    (int2)(2, 0), (int2)(-2, 0), (int2)(0, 2), (int2)(0, -2), (int2)(2, 1), (int2)(-2, -1), (int2)(1, -2), (int2)(-1, 2),
    (int2)(2, -1), (int2)(-2, 1), (int2)(1, 2), (int2)(-1, -2), (int2)(2, 2), (int2)(-2, -2), (int2)(2, -2), (int2)(-2, 2),
};

// Where a pixel lies in the film's tiles, as rendering/film.py lays them out.
static uint place_of(uint x, uint y, uint across)
{
    uint tile = y / TILE * across + x / TILE;
    uint quarter = tile * (TILE / QUARTER) * (TILE / QUARTER) + y % TILE / QUARTER * (TILE / QUARTER) + x % TILE / QUARTER;
    return quarter * QUARTER * QUARTER + y % QUARTER * QUARTER + x % QUARTER;
}

__kernel void guides(__global const float *layers,   // sums of the layers, and their compensations
                     __global const float *picture,  // [height][width][3]
                     __global float       *out,      // albedo, normal, position [m], blur [pixels], whether there is a pixel
                     __global float       *light,    // picture, albedo by weight, albedo of what is blurred, variance, weight
                     uint4                 places,   // of albedo, normal and position among the sums
                     uint4                 sizes,    // width, height, pixels from row to row, margin
                     uint                  sums,     // planes of sums
                     uint                  pixels,   // of a plane of the layers
                     uint                  plane,    // pixels of a plane of `out` and `light`
                     float4                camera)   // 1 / samples; blur of what is 1 / m nearer than the focus [pixels], 1 / focus [1 / m]
{
    uint across = (sizes.x + TILE - 1) / TILE, items = (sizes.x + QUARTER - 1) / QUARTER;
    uint x = get_global_id(0) % items * QUARTER, y = get_global_id(0) / items;
    if (y >= sizes.y)
        return;
    uint from = place_of(x, y, across);
    uint to = (y + sizes.w) * sizes.z + x + sizes.w;
    uint place[11] = { 0u, 1u, places.x, places.x + 1, places.x + 2, places.y, places.y + 1, places.y + 2,
                       places.z, places.z + 1, places.z + 2 };
    float4 value[11];
    for (int k = 0; k < 11; ++k)
        value[k] = vload4(0, layers + (size_t)place[k] * pixels + from) - vload4(0, layers + (size_t)(sums + place[k]) * pixels + from);
    float4 weight = value[0] * camera.x, seen[3];
    float *lanes[11];
    for (int k = 0; k < 11; ++k)
        lanes[k] = (float *)&value[k];
    for (uint lane = 0; lane < QUARTER; ++lane) {
        uint pixel = 3 * (y * sizes.x + min(x + lane, sizes.x - 1));
        for (int k = 0; k < 3; ++k)
            ((float *)&seen[k])[lane] = picture[pixel + k];
        // The lens stops the rays of some pixels: they lie on the surface that a neighbour sees.
        for (int n = 0; n < 24 && lanes[0][lane] == 0.0f; ++n) {
            int i = (int)(x + lane) + NEAR[n].x, j = (int)y + NEAR[n].y;
            if (i < 0 || j < 0 || i >= (int)sizes.x || j >= (int)sizes.y)
                continue;
            uint other = place_of(i, j, across);
            if (layers[other] != 0.0f)
                for (int k = 0; k < 11; ++k)
                    lanes[k][lane] = layers[(size_t)place[k] * pixels + other] - layers[(size_t)(sums + place[k]) * pixels + other];
        }
    }
    float4 passes = value[0] > 0.0f ? 1.0f / value[0] : 0.0f, met = value[1] > 0.0f ? 1.0f / value[1] : 0.0f;
    float4 beyond = 1.0f - value[1] * passes;                // what is not met has no colour of its own
    float4 size = value[5] * value[5] + value[6] * value[6] + value[7] * value[7];
    float4 unit = size > 0.0f ? rsqrt(size) : 0.0f;
    float4 lamp = clamp(fmax(fmax(seen[0], seen[1]), seen[2]) / GLARE - 1.0f, 0.0f, 1.0f);
    for (int k = 0; k < 3; ++k) {
        float4 albedo = mix(fmax(value[2 + k] * passes + beyond, LEAST_ALBEDO), 1.0f, lamp);
        vstore4(albedo, 0, out + (size_t)k * plane + to);
        vstore4(value[5 + k] * unit, 0, out + (size_t)(3 + k) * plane + to);
        vstore4(value[8 + k] * met, 0, out + (size_t)(6 + k) * plane + to);
        vstore4(seen[k], 0, light + (size_t)k * plane + to);
        vstore4(albedo * weight, 0, light + (size_t)(3 + k) * plane + to);
        vstore4(albedo, 0, light + (size_t)(6 + k) * plane + to);
    }
    float4 away = sqrt(value[8] * value[8] + value[9] * value[9] + value[10] * value[10]) * met;
    float4 nearness = away > 0.0f ? 1.0f / away : 0.0f;
    vstore4(camera.y * fabs(nearness - camera.z), 0, out + (size_t)9 * plane + to);
    vstore4((uint4)(x, x + 1, x + 2, x + 3) < sizes.x ? 1.0f : 0.0f, 0, out + (size_t)10 * plane + to);
    vstore4(0.0f, 0, light + (size_t)9 * plane + to);
    vstore4(weight, 0, light + (size_t)10 * plane + to);
}
