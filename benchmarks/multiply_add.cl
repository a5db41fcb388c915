// The device's peak of multiply-adds: CHAINS independent chains per lane, each longer than any latency, all in registers.
__kernel void multiply_add(__global F *out, float factor, float summand, int rounds)
{
    F chain[CHAINS];
    for (int k = 0; k < CHAINS; ++k)
        chain[k] = (F)((float)k) + summand * (float)get_global_id(0);
    for (int round = 0; round < rounds; ++round) {
#pragma unroll
        for (int k = 0; k < CHAINS; ++k)
            chain[k] = chain[k] * factor + summand;
    }
    F sum = (F)(0.0f);
    for (int k = 0; k < CHAINS; ++k)
        sum += chain[k];
    out[get_global_id(0)] = sum;
}
