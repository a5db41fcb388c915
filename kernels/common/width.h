// Width-generic types: a work item handles VW neighbouring lanes (8 or 16 on a CPU, 1 on a GPU); F, I, U are VW floats,
// ints, uints. A comparison gives a mask: every bit set in a true lane (VW > 1), or 1 (VW == 1). Masks are combined with
// & and |, negated with NOT, used by the ternary operator, tested with ANY and counted with COUNT.
// With DOUBLE the lanes are double and long, for the float64 lens tracer: eight of them or one. LOAD_SINGLE and STORE_SINGLE
// then read and write floats.
#ifndef WIDTH_H
#define WIDTH_H

#if DOUBLE && VW == 1
typedef double F;
typedef long   I;
typedef ulong  U;
#define NOT(m)    (!(m))
#define ANY(m)    (m)
#define COUNT(m)  ((uint)((m) != 0))
#define LANES     (0)
#define GATHER(T, p, i, member) ((p)[i] member)
#define TO_F(v)   ((double)(v))
#define TO_I(v)   ((long)(v))
#define AS_F(v)   as_double(v)
#define AS_I(v)   as_long(v)
#define AS_U(v)   as_ulong(v)
#define LOAD_SINGLE(p, i)      ((double)(p)[i])
#define STORE_SINGLE(p, i, v)  ((p)[i] = (float)(v))

#elif DOUBLE
typedef double8 F;
typedef long8   I;
typedef ulong8  U;
#define LANES     ((I)(0, 1, 2, 3, 4, 5, 6, 7))
#define TO_F(v)   convert_double8(v)
#define TO_I(v)   convert_long8(v)
#define AS_F(v)   as_double8(v)
#define AS_I(v)   as_long8(v)
#define AS_U(v)   as_ulong8(v)
#define GATHER(T, p, i, member) \
    ((T)((p)[(i).s0] member, (p)[(i).s1] member, (p)[(i).s2] member, (p)[(i).s3] member, \
         (p)[(i).s4] member, (p)[(i).s5] member, (p)[(i).s6] member, (p)[(i).s7] member))
#ifdef CLANG_AVX512
#define MASK_BITS(m) ((uint)(uchar)__builtin_ia32_cvtq2mask512(m))
#elif defined CLANG_AVX2
#define MASK_BITS(m) ((uint)__builtin_ia32_movmskpd256(as_double4((m).lo)) \
                    | ((uint)__builtin_ia32_movmskpd256(as_double4((m).hi)) << 4))
#endif
#define LOAD_SINGLE(p, i)      convert_double8(vload8(0, (p) + (i)))
#define STORE_SINGLE(p, i, v)  vstore8(convert_float8(v), 0, (p) + (i))

#elif VW == 1
typedef float F;
typedef int   I;
typedef uint  U;
#define NOT(m)    (!(m))
#define ANY(m)    (m)
#define COUNT(m)  ((uint)((m) != 0))
#define LANES     (0)
#define GATHER(T, p, i, member) ((p)[i] member)
#define TO_F(v)   ((float)(v))
#define TO_I(v)   ((int)(v))
#define AS_F(v)   as_float(v)
#define AS_I(v)   as_int(v)
#define AS_U(v)   as_uint(v)

#elif VW == 8
typedef float8 F;
typedef int8   I;
typedef uint8  U;
#define LANES     ((I)(0, 1, 2, 3, 4, 5, 6, 7))
#define GATHER(T, p, i, member) \
    ((T)((p)[(i).s0] member, (p)[(i).s1] member, (p)[(i).s2] member, (p)[(i).s3] member, \
         (p)[(i).s4] member, (p)[(i).s5] member, (p)[(i).s6] member, (p)[(i).s7] member))
#define TO_F(v)   convert_float8(v)
#define TO_I(v)   convert_int8(v)
#define AS_F(v)   as_float8(v)
#define AS_I(v)   as_int8(v)
#define AS_U(v)   as_uint8(v)
#ifdef CLANG_AVX2
#define MASK_BITS(m) ((uint)__builtin_ia32_movmskps256(as_float8(m)))
#endif

#elif VW == 16
typedef float16 F;
typedef int16   I;
typedef uint16  U;
#define LANES     ((I)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#define GATHER(T, p, i, member) \
    ((T)((p)[(i).s0] member, (p)[(i).s1] member, (p)[(i).s2] member, (p)[(i).s3] member, \
         (p)[(i).s4] member, (p)[(i).s5] member, (p)[(i).s6] member, (p)[(i).s7] member, \
         (p)[(i).s8] member, (p)[(i).s9] member, (p)[(i).sa] member, (p)[(i).sb] member, \
         (p)[(i).sc] member, (p)[(i).sd] member, (p)[(i).se] member, (p)[(i).sf] member))
#define TO_F(v)   convert_float16(v)
#define TO_I(v)   convert_int16(v)
#define AS_F(v)   as_float16(v)
#define AS_I(v)   as_int16(v)
#define AS_U(v)   as_uint16(v)
#ifdef CLANG_AVX512
#define MASK_BITS(m) ((uint)(ushort)__builtin_ia32_cvtd2mask512(m))
#elif defined CLANG_AVX2
#define MASK_BITS(m) ((uint)__builtin_ia32_movmskps256(as_float8((m).lo)) \
                    | ((uint)__builtin_ia32_movmskps256(as_float8((m).hi)) << 8))
#endif
#endif

#if DOUBLE
#define SIGN_BIT  ((I)((long)0x8000000000000000UL))
#define INFINITE  0x7ff0000000000000L
#define CRITICAL  1e-15
#define LAST_STEP 1e-9
#define SMALLEST  1e-300
#define NEWTON_STEPS 24
#define EXPONENT_BIAS  1023
#define EXPONENT_SHIFT 52
#define LANE_INT  long
#else
#define SIGN_BIT  ((I)((int)0x80000000))
#define INFINITE  0x7f800000
#define CRITICAL  1e-6f      // relative distance from the critical angle that float32 cannot resolve
#define LAST_STEP 1e-4f      // of the distance scale: after such a Newton step the error is less than rounding
#define SMALLEST  1e-36f
#define NEWTON_STEPS 24
#define EXPONENT_BIAS  127
#define EXPONENT_SHIFT 23
#define LANE_INT  int
#endif

#ifdef CLANG_AVX2
#define IN_PLACE          __attribute__((always_inline))   // what a loop must not call with wide vectors
#else
#define IN_PLACE
#endif

#ifdef CLANG_AVX2
#define LOWEST_BIT(bits)  ((uint)__builtin_ctz(bits))      // OpenCL C 1.2 has clz alone
#else
#define LOWEST_BIT(bits)  (31u - clz((bits) & (0u - (bits))))
#endif

#if VW > 1
#define NOT(m)    (~(m))
#ifdef MASK_BITS
#define ANY(m)    (MASK_BITS(m) != 0u)
#else
#define ANY(m)    any(m)
#define MASK_BITS(m) mask_bits(m)
static uint mask_bits(I m)
{
    const LANE_INT *lane = (const LANE_INT *)&m;
    uint bits = 0u;
    for (int i = 0; i < VW; ++i)
        bits |= lane[i] != 0 ? 1u << i : 0u;
    return bits;
}
#endif
#define COUNT(m)  ((uint)popcount(MASK_BITS(m)))

// The value of the first true lane.
static inline int first_of(I values, I m)
{
    uint bits = MASK_BITS(m);
    const LANE_INT *lane = (const LANE_INT *)&values;
    return (int)lane[LOWEST_BIT(bits)];
}
#else
static inline int first_of(I values, I m) { return values; }
#endif

// A mask that is kept for long: a bit a lane, where the processor has registers of them, else as it comes.
#if VW == 16 && defined CLANG_AVX512
typedef ushort Kept;
#define KEPT(m)        ((Kept)MASK_BITS(m))
#define MASK_OF(kept)  as_int16(__builtin_ia32_cvtmask2d512(kept))
#define ANY_KEPT(kept) ((kept) != 0)
#else
typedef I Kept;
#define KEPT(m)        (m)
#define MASK_OF(kept)  (kept)
#define ANY_KEPT(kept) ANY(kept)
#endif

// Intel's compiler takes eight work items together where it fears for its registers, and sixteen by request.
#if SHORT_STACK && defined cl_intel_required_subgroup_size
#define SIXTEEN_TOGETHER __attribute__((intel_reqd_sub_group_size(16)))
#else
#define SIXTEEN_TOGETHER
#endif

#define FALSE     ((I)(0))
#define TRUE      NOT(FALSE)
#define ZERO      ((F)(0.0f))
#define ONE       ((F)(1.0f))
#define LOAD_F(p, i)      (*(__global const F *)((p) + (i)))
#define LOAD_I(p, i)      (*(__global const I *)((p) + (i)))
#define STORE_F(p, i, v)  (*(__global F *)((p) + (i)) = (v))
#define STORE_I(p, i, v)  (*(__global I *)((p) + (i)) = (v))
#define MIN(a, b)         ((a) < (b) ? (a) : (b))
#define MAX(a, b)         ((a) > (b) ? (a) : (b))

// The greatest whole numbers that are no greater. PoCL's own function takes ten instructions where the processor has one.
#if VW == 16 && defined CLANG_AVX512
#define FLOOR(v)  __builtin_ia32_rndscaleps_mask(v, 1, v, (ushort)0xffff, 4)
#elif VW == 8 && defined CLANG_AVX2 && !DOUBLE
#define FLOOR(v)  __builtin_ia32_roundps256(v, 1)
#else
#define FLOOR(v)  floor(v)
#endif

#endif
