// The built-in functions that kernels use, for PoCL 3.0, which else reads the declarations of all 15,000 before each program
// (`options_of` in device/programs.py). Of each name all overloads of these types stand here, as the compiler's own header
// declares them, so that a call means the same; a test compares the two.
#ifdef DECLARES_BUILTINS

#define EACH_WIDTH(DECLARE, type) DECLARE(type##2) DECLARE(type##3) DECLARE(type##4) DECLARE(type##8) DECLARE(type##16)
#define EACH_FLOAT(DECLARE)     DECLARE(float) EACH_WIDTH(DECLARE, float)
#define EACH_DOUBLE(DECLARE)    DECLARE(double) EACH_WIDTH(DECLARE, double)
#define EACH_INTEGER(DECLARE) \
    DECLARE(int) EACH_WIDTH(DECLARE, int) DECLARE(uint) EACH_WIDTH(DECLARE, uint) \
    DECLARE(long) EACH_WIDTH(DECLARE, long) DECLARE(ulong) EACH_WIDTH(DECLARE, ulong)
#define CONSTANT __attribute__((overloadable, const))
#define READING  __attribute__((overloadable, pure))
#define WRITING  __attribute__((overloadable))

size_t CONSTANT get_global_id(uint dimension);
void __attribute__((overloadable, convergent)) barrier(cl_mem_fence_flags flags);

#define OF_ONE(type) \
    type CONSTANT sqrt(type); type CONSTANT rsqrt(type); type CONSTANT exp(type); type CONSTANT log(type); \
    type CONSTANT sin(type); type CONSTANT cos(type); type CONSTANT tan(type); type CONSTANT atan(type); \
    type CONSTANT sinh(type); type CONSTANT tanh(type); type CONSTANT fabs(type); type CONSTANT floor(type); \
    type CONSTANT round(type); type CONSTANT sign(type); type CONSTANT radians(type); \
    type CONSTANT pow(type, type); type CONSTANT hypot(type, type); type CONSTANT fmax(type, type); \
    type CONSTANT mix(type, type, type);
EACH_FLOAT(OF_ONE)
EACH_DOUBLE(OF_ONE)
#define WITH_SCALAR(type, scalar) type CONSTANT fmax(type, scalar); type CONSTANT mix(type, type, scalar);
#define WITH_FLOAT(type)  WITH_SCALAR(type, float)
#define WITH_DOUBLE(type) WITH_SCALAR(type, double)
EACH_WIDTH(WITH_FLOAT, float)
EACH_WIDTH(WITH_DOUBLE, double)

#define ORDERED(type) \
    type CONSTANT min(type, type); type CONSTANT max(type, type); type CONSTANT clamp(type, type, type);
EACH_INTEGER(ORDERED)
EACH_FLOAT(ORDERED)
EACH_DOUBLE(ORDERED)
#define ORDERED_BY(type, scalar) \
    type CONSTANT min(type, scalar); type CONSTANT max(type, scalar); type CONSTANT clamp(type, scalar, scalar);
#define ORDERED_BY_INT(type)    ORDERED_BY(type, int)
#define ORDERED_BY_UINT(type)   ORDERED_BY(type, uint)
#define ORDERED_BY_LONG(type)   ORDERED_BY(type, long)
#define ORDERED_BY_ULONG(type)  ORDERED_BY(type, ulong)
#define ORDERED_BY_FLOAT(type)  ORDERED_BY(type, float)
#define ORDERED_BY_DOUBLE(type) ORDERED_BY(type, double)
EACH_WIDTH(ORDERED_BY_INT, int)
EACH_WIDTH(ORDERED_BY_UINT, uint)
EACH_WIDTH(ORDERED_BY_LONG, long)
EACH_WIDTH(ORDERED_BY_ULONG, ulong)
EACH_WIDTH(ORDERED_BY_FLOAT, float)
EACH_WIDTH(ORDERED_BY_DOUBLE, double)

#define OF_BITS(type) type CONSTANT clz(type); type CONSTANT popcount(type);
EACH_INTEGER(OF_BITS)
OF_BITS(char) OF_BITS(uchar) OF_BITS(short) OF_BITS(ushort)
#define MAGNITUDE(width) \
    uint##width CONSTANT abs(int##width); uint##width CONSTANT abs(uint##width); \
    ulong##width CONSTANT abs(long##width); ulong##width CONSTANT abs(ulong##width);
MAGNITUDE() MAGNITUDE(2) MAGNITUDE(3) MAGNITUDE(4) MAGNITUDE(8) MAGNITUDE(16)
#define OF_SIGNS(type) int CONSTANT any(type); int CONSTANT all(type);
OF_SIGNS(char) OF_SIGNS(short) OF_SIGNS(int) OF_SIGNS(long)
EACH_WIDTH(OF_SIGNS, int)
EACH_WIDTH(OF_SIGNS, long)

#define CROSS(type) type CONSTANT cross(type, type);
CROSS(float3) CROSS(float4) CROSS(double3) CROSS(double4)

#define CONVERTED_TO(to, width) \
    to##width CONSTANT convert_##to##width(int##width); to##width CONSTANT convert_##to##width(uint##width); \
    to##width CONSTANT convert_##to##width(long##width); to##width CONSTANT convert_##to##width(ulong##width); \
    to##width CONSTANT convert_##to##width(float##width); to##width CONSTANT convert_##to##width(double##width);
CONVERTED_TO(int, 8) CONVERTED_TO(int, 16) CONVERTED_TO(long, 8)
CONVERTED_TO(float, 4) CONVERTED_TO(float, 8) CONVERTED_TO(float, 16)
CONVERTED_TO(double, 4) CONVERTED_TO(double, 8) CONVERTED_TO(double, 16)

#define LOADED_FROM(space, type, width) type##width READING vload##width(size_t, const space type *);
#define STORED_TO(space, type, width)   void WRITING vstore##width(type##width, size_t, space type *);
#define MOVED(type, width) \
    LOADED_FROM(__global, type, width) LOADED_FROM(__constant, type, width) LOADED_FROM(__local, type, width) \
    LOADED_FROM(__private, type, width) \
    STORED_TO(__global, type, width) STORED_TO(__local, type, width) STORED_TO(__private, type, width)
#define MOVED_BY(width) \
    MOVED(int, width) MOVED(uint, width) MOVED(long, width) MOVED(ulong, width) MOVED(float, width) MOVED(double, width)
MOVED_BY(2) MOVED_BY(4) MOVED_BY(8) MOVED_BY(16)

int WRITING atomic_add(volatile __global int *, int);
int WRITING atomic_add(volatile __local int *, int);
uint WRITING atomic_add(volatile __global uint *, uint);
uint WRITING atomic_add(volatile __local uint *, uint);

#undef CONSTANT
#undef READING
#undef WRITING
#endif
