// Counts the steps of two loops, one inside the other, in a way that no compiler does without taking them.
__kernel void probe_loops(__global uint *out, uint outer, uint inner)
{
    uint word = 1u, steps = 0u;
    for (uint i = 0; i < outer; ++i)
        for (uint k = 0; k < inner; ++k) {
            word = word * 1664525u + 1013904223u;       // never ends in zero bits alone: its period is 2^32
            steps += word != 0u ? 1u : 0u;
        }
    out[0] = steps;
}
