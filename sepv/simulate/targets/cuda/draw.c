/* Wiener increments with the bits of `sepv.simulate._wiener`: a path has streams of SFC64, whose normals are those of
   NumPy's ziggurat, and Lévy's construction halves coarse increments level by level. All arrays have the path as last
   axis, so that neighbouring threads touch neighbouring numbers. */
typedef struct { u64 a, b, c, counter; } Stream;

DEVICE u64 next(Stream *s) {
  const u64 found = s->a + s->b + s->counter++;
  s->a = s->b ^ (s->b >> 11);
  s->b = s->c + (s->c << 3);
  s->c = ((s->c << 24) | (s->c >> 40)) + found;
  return found;
}
DEVICE double uniform(Stream *s) { return (double)(i64)(next(s) >> 11) * (1.0 / 9007199254740992.0); }

/* The ziggurat's layers: LIMITS are integers below 2^52, WIDTHS and HEIGHTS are of the curve exp(-x²/2). */
typedef struct { const u64 *limits; const double *widths, *heights; } Layers;
#define TAIL 3.6541528853610087963519472518
#define INVERSE_TAIL 0.27366123732975827203338247596

/* Continue from the draw r, which its layer's rectangle has not accepted: one normal in 67. */
RARE double ziggurat(Stream *s, u64 r, Layers layers) {
  for (;;) {
    const int i = (int)(r & 0xff);
    const u64 size = (r >> 9) & 0x000fffffffffffffULL;
    double x = (double)size * layers.widths[i];
    if (r & 0x100) x = -x;
    if (size < layers.limits[i]) return x;
    if (i == 0) {
      for (;;) {
        const double xx = -INVERSE_TAIL * log1p(-uniform(s)), yy = -log1p(-uniform(s));
        if (yy + yy > xx * xx) return (r >> 17) & 1 ? -(TAIL + xx) : TAIL + xx;
      }
    }
    if ((layers.heights[i - 1] - layers.heights[i]) * uniform(s) + layers.heights[i] < exp(-0.5 * x * x)) return x;
    r = next(s);
  }
}
DEVICE double normal(Stream *s, Layers layers) {
  const u64 r = next(s), size = (r >> 9) & 0x000fffffffffffffULL;
  const int i = (int)(r & 0xff);
  const double x = (double)size * layers.widths[i];
  if (size < layers.limits[i]) return r & 0x100 ? -x : x;
  return ziggurat(s, r, layers);
}

DEVICE Stream load(const u64 *states, i64 stream, i64 M, i64 p) {
  const u64 *at = states + stream * 4 * M + p;
  const Stream found = {at[0], at[M], at[2 * M], at[3 * M]};
  return found;
}
DEVICE void save(u64 *states, i64 stream, i64 M, i64 p, Stream s) {
  u64 *at = states + stream * 4 * M + p;
  at[0] = s.a, at[M] = s.b, at[2 * M] = s.c, at[3 * M] = s.counter;
}

/* On a card each block of threads has the two tables of the fast path in its shared memory. */
#ifdef __CUDACC__
#define LAYERS(layers, limits_, widths_, heights_) \
  __shared__ u64 limits_here[256]; \
  __shared__ double widths_here[256]; \
  for (int i = threadIdx.x; i < 256; i += blockDim.x) limits_here[i] = limits_[i], widths_here[i] = widths_[i]; \
  __syncthreads(); \
  const Layers layers = {limits_here, widths_here, heights_};
#else
#define LAYERS(layers, limits_, widths_, heights_) const Layers layers = {limits_, widths_, heights_};
#endif

/* Halve increments of m noises: left halves stay in `whole`, right halves go to `right`. Contraction to fma is off in
   this text on every device, so that the roundings are NumPy's. */
DEVICE void halve(double *whole, double *right, double z) {
  const double before = *whole, left = 0.5 * before + z;
  *whole = left;
  *right = before - left;
}

/* Set up the streams (streams, 4, M) of M paths, numbered from `first` on, and draw the n normals (n, m, M) of the
   coarse levels, in the order of the first stream. `words` (streams, 3) are the state words of path 0. */
KERNEL void begin(i64 M, u64 first, i64 streams, const u64 *words, u64 *states, double *normals, i64 n,
                  const u64 *limits, const double *widths, const double *heights) {
  LAYERS(layers, limits, widths, heights)
  EACH(p, M) {
    for (i64 s = streams - 1; s >= 0; s--) {
      Stream own = {words[3 * s], words[3 * s + 1], words[3 * s + 2] + STREAMS * (first + (u64)p), 1ULL};
      for (int i = 0; i < MIXING; i++) next(&own);
      if (s == 0)
        for (i64 i = 0; i < n * NOISES; i++) normals[i * M + p] = normal(&own, layers);
      save(states, s, M, p, own);
    }
  }
}

/* The coarse increment number c (m,), of base·2^top of them, from normals (n, m, M) in the order of levels. `right`
   keeps the right halves of the levels on the way; with `fresh` it is empty, and all of them are made. */
DEVICE void coarse_increment(i64 c, int fresh, i64 base, int top, const double *factors, const double *normals, i64 M,
                             double *right, double *v) {
  int known = top;
  while (known > 0 && (fresh || !(c >> (top - known) & 1))) known--;
  for (int j = 0; j < NOISES; j++) {
    double here = known ? right[known * NOISES + j] : factors[0] * normals[((c >> top) * NOISES + j) * M];
    for (int level = known + 1; level <= top; level++) {
      const i64 n = (base << (level - 1)) + (c >> (top - level + 1));
      double other;
      halve(&here, &other, factors[level] * normals[(n * NOISES + j) * M]);
      if (fresh && (c >> (top - level) & 1)) here = other;
      else right[level * NOISES + j] = other;
    }
    v[j] = here;
  }
}

/* Halve an increment v (2^K, m), whose first entry is given, K times, with the streams of the last K levels. */
DEVICE void halvings(const int K, double *v, Stream *streams, const double *factors, Layers layers) {
  UNROLLED for (int level = 1; level <= K; level++) {
    const int half = (1 << K) >> level;
    UNROLLED for (int i = 0; i < 1 << K; i += 2 * half) {
      UNROLLED for (int j = 0; j < NOISES; j++)
          halve(v + i * NOISES + j, v + (i + half) * NOISES + j, factors[level] * normal(streams + level - 1, layers));
    }
  }
}

/* The last K levels of a block of `count` steps, in registers. `parents` says where their increments come from: 0, they
   are in `out`; 1, they are coarse increments of normals; 2, stream 0 draws them. */
DEVICE void finest(const int K, i64 p, i64 M, i64 first, i64 count, int parents, u64 *states, const double *normals,
                   i64 base, double *out, i64 fine, const double *factors, int top, Layers layers) {
  double v[NOISES << IN_REGISTERS], right[(TOP_LEVELS + 1) * NOISES];
  Stream own[IN_REGISTERS], coarse;
  UNROLLED for (int k = 0; k < K; k++) own[k] = load(states, fine - K + 1 + k, M, p);
  if (parents == 2) coarse = load(states, 0, M, p);
  for (i64 s = 0; s < count; s += 1 << K) {
    UNROLLED for (int j = 0; j < NOISES; j++) {
      if (parents == 0) v[j] = out[(s * NOISES + j) * M + p];
      if (parents == 2) v[j] = factors[0] * normal(&coarse, layers);
    }
    if (parents == 1) coarse_increment((first + s) >> K, s == 0, base, top, factors, normals + p, M, right, v);
    halvings(K, v, own, factors + top + fine - K, layers);
    UNROLLED for (int i = 0; i < NOISES << K; i++) out[(s * NOISES + i) * M + p] = v[i];
  }
  UNROLLED for (int k = 0; k < K; k++) save(states, fine - K + 1 + k, M, p, own[k]);
  if (parents == 2) save(states, 0, M, p, coarse);
}

/* Write the increments of the steps first … first + count − 1 to out (count, m, M). `first` and `count` are multiples
   of the steps of the last levels, which are halved in registers; a longer increment is halved in memory, level by
   level, and `stack` (fine + 1, m, M) keeps its right half for a later call. Coarse increments are made of `normals`
   if base > 0, else drawn from stream 0. */
KERNEL void fill(i64 M, i64 first, i64 count, u64 *states, double *stack, const double *normals, i64 base, double *out,
                 i64 fine, const double *factors, i64 top, const u64 *limits, const double *widths,
                 const double *heights) {
  LAYERS(layers, limits, widths, heights)
  EACH(p, M) {
    const i64 K = fine < IN_REGISTERS ? fine : IN_REGISTERS, upper = fine - K, end = first + count;
    int parents = base ? 1 : 2;
    if (upper) {
      const i64 length = (i64)1 << fine;
      double right[(TOP_LEVELS + 1) * NOISES], v[NOISES + 1];
      i64 known = fine;
      while (known > 0 && !(first >> (fine - known) & 1)) known--;
      for (int j = 0; j < NOISES && known > 0; j++) out[j * M + p] = stack[(known * NOISES + j) * M + p];
      Stream own = load(states, 0, M, p);
      for (i64 s = (first + length - 1) / length * length; s < end; s += length) {
        if (base) coarse_increment(s >> fine, 1, base, (int)top, factors, normals + p, M, right, v);
        for (int j = 0; j < NOISES; j++)
          out[((s - first) * NOISES + j) * M + p] = base ? v[j] : factors[0] * normal(&own, layers);
      }
      if (!base) save(states, 0, M, p, own);
      for (i64 level = 1; level <= upper; level++) {
        const i64 half = (i64)1 << (fine - level), start = (first + 2 * half - 1) / (2 * half) * (2 * half);
        if (start >= end) continue;
        own = load(states, level, M, p);
        for (i64 s = start; s < end; s += 2 * half)
          for (int j = 0; j < NOISES; j++) {
            double *right_half = s + half < end ? out + ((s + half - first) * NOISES + j) * M + p
                                                : stack + (level * NOISES + j) * M + p;
            halve(out + ((s - first) * NOISES + j) * M + p, right_half, factors[top + level] * normal(&own, layers));
          }
        save(states, level, M, p, own);
      }
      parents = 0;
    }
    switch (K) {
      case 0: finest(0, p, M, first, count, parents, states, normals, base, out, fine, factors, (int)top, layers); break;
      case 1: finest(1, p, M, first, count, parents, states, normals, base, out, fine, factors, (int)top, layers); break;
      case 2: finest(2, p, M, first, count, parents, states, normals, base, out, fine, factors, (int)top, layers); break;
      default: finest(3, p, M, first, count, parents, states, normals, base, out, fine, factors, (int)top, layers);
    }
  }
}
