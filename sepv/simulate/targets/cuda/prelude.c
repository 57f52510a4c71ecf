/* One text for two compilers: NVRTC, which runs a kernel's paths as threads of a card, and a C compiler, which runs
   them in a loop. The second is for tests where there is no card; it is compiled without contraction to fma. */
typedef long long i64;
typedef unsigned long long u64;
#ifdef __CUDACC__
#define DEVICE static __device__ __forceinline__
#define RARE static __device__ __noinline__
#define KERNEL extern "C" __global__
#define CONSTANT __constant__ const
#define EACH(p, total) \
  const i64 p = blockIdx.x * (i64)blockDim.x + threadIdx.x; \
  if (p < (total))
#define UNROLLED _Pragma("unroll")
#define INF __longlong_as_double(0x7ff0000000000000LL)
/* 1/x to 2^-20, for tests that compare sizes. */
DEVICE double roughly(double x) {
  double found;
  asm("rcp.approx.ftz.f64 %0, %1;" : "=d"(found) : "d"(x));
  return found;
}
DEVICE int magnitude(double x) { return __double2hiint(x) & 0x7fffffff; }
DEVICE double of_magnitude(int high) { return __hiloint2double(high, 0); }
#else
#include <math.h>
#include <string.h>
#define DEVICE static inline
#define RARE static
#define KERNEL
#define CONSTANT static const
#define EACH(p, total) for (i64 p = 0; p < (total); p++)
#define UNROLLED
#define INF ((double)INFINITY)
DEVICE double roughly(double x) { return 1.0 / x; }
DEVICE int magnitude(double x) {
  i64 bits;
  memcpy(&bits, &x, 8);
  return (int)(bits >> 32) & 0x7fffffff;
}
DEVICE double of_magnitude(int high) {
  const i64 bits = (i64)high << 32;
  double x;
  memcpy(&x, &bits, 8);
  return x;
}
#endif

/* The size |x| to 2^-20 as the high word of its bits, because a card compares integers far faster than doubles. */
#define NOT_FINITE 0x7ff00000
DEVICE int larger(int a, int b) { return a > b ? a : b; }
