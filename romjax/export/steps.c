/* Steps of a model and their control, those of romjax.simulate.
 *
 * Before this text stand the numbers of the model (N coordinates, KIND: 1 of positions of bodies,
 * SHARE: of the tolerances of their kind, as the model that was exported has them),
 * the coefficients of the methods, and the functions model_rate and, where they are needed,
 * model_linear and model_longest. What these are given besides t and x is for them alone.
 * With ALONG each function keeps numbers that its derivatives along directions take.
 */
#if defined(__GNUC__) && !defined(__clang__) && N <= 8
/* Loops over few numbers are unrolled, which takes the compiler a tenth of a second. */
#pragma GCC optimize("O3")
#endif
enum { SUCCESS = 0, MAX_STEPS = 1, NOT_FINITE = 2, BAD_START = 3, VIOLATED = 6 };
enum { DOPRI8 = 0, RODAS5P = 1 };
#define X (2 * N)
#define EPS 2.220446049250313e-16
/* As romjax/march/tolerances.py, steps.py and step_size.py have them. */
#define ROUNDING 20
#define NEAR_END 100
#define SAFETY 0.9
#define SHORTER 0.2
#define LONGER 10.0

typedef struct {
  double rtol, atol, dt, t1, least;
  int method, follow, corners;
  int64_t max_steps;
  const double *corner, *given;
  double *kept;
  double fine; /* rtol of steps, as turning_rtol has it */
} settings;

/* Where numbers are kept: those of the rates of each stage first. */
#ifdef ALONG
#define KEPT(where) , where
#define KEPT_LATER (STAGES * KEPT_RATE)
#else
#define KEPT(where)
#endif

typedef struct {
  double origin[N], distance[2], speed[2], farthest[2];
} reach;

typedef struct {
  double y[X], z[X], k[STAGES][X], a[N], by_q[N * N], by_v[N * N], by_t[N], w[N * N];
  int pivot[N], fresh;
  reach so_far;
} state;

static double larger(double a, double b) { return a > b || a != a ? a : b; }
static double smaller(double a, double b) { return a < b || a != a ? a : b; }

static void slope(double t, const double *x, const settings *s, int stage, double *dx) {
  (void)stage;
  for (int i = 0; i < N; i++) dx[i] = x[N + i];
  model_rate(t, x, s->given, dx + N KEPT(s->kept + stage * KEPT_RATE));
}

/* Tolerances. */

/* As romjax/integrate/turning.py has it. */
static double turning_rtol(const settings *s, double turning, double span) {
  double turns = turning * span / (2 * 3.141592653589793), fewest = s->method == DOPRI8 ? 5 : 3;
  double share = 3 / smaller(larger(turns, fewest), 100);
  return larger(s->rtol * share * share, smaller(s->rtol, 500 * EPS));
}

static void extend(reach *r, const double *x) {
  for (int i = 0; i < N; i++) {
    int kind = KIND[i];
    r->distance[kind] = larger(fabs(x[i] - r->origin[i]), r->distance[kind]);
    r->speed[kind] = larger(fabs(x[N + i]), r->speed[kind]);
    r->farthest[kind] = larger(fabs(x[i]), r->farthest[kind]);
  }
}

static void begin(reach *r, const double *x) {
  for (int kind = 0; kind < 2; kind++) r->distance[kind] = r->speed[kind] = 0;
  r->farthest[0] = 1.0;
  r->farthest[1] = 1e-3;
  for (int i = 0; i < N; i++) r->origin[i] = x[i];
  extend(r, x);
}

/* The root mean square of errors, each over its tolerance, of a step from x to the end z. */
static double scaled(const settings *s, reach *r, const double *x, const double *z,
                     const double *error, double h) {
  double sum = 0, end[X];
  for (int i = 0; i < X; i++) end[i] = isfinite(z[i]) ? z[i] : x[i];
  extend(r, end);
  for (int i = 0; i < N; i++) {
    int kind = KIND[i];
    double noise = ROUNDING * EPS * r->farthest[kind], by_q, by_v;
    if (s->follow) {
      double from = fabs(x[i] - r->origin[i]), to = fabs(end[i] - r->origin[i]);
      double moved = larger(from, to), fast = larger(fabs(x[N + i]), fabs(end[N + i]));
      by_q = s->fine * larger(smaller(r->distance[kind], 1) * SHARE[i], moved) + noise;
      by_v = s->fine * larger(smaller(r->speed[kind], 1) * SHARE[i], fast) + noise / h;
    } else {
      by_q = s->atol + s->rtol * larger(fabs(x[i]), fabs(end[i]));
      by_v = s->atol + s->rtol * larger(fabs(x[N + i]), fabs(end[N + i]));
    }
    double eq = error[i], ev = error[N + i];
    if (eq != eq || ev != ev) return INFINITY;
    sum += eq / by_q * (eq / by_q) + ev / by_v * (ev / by_v);
  }
  return sqrt(sum / larger(X, 1));
}

/* x = sum of w[l] k[l] over some stages: many weights are zero. */
static void combine(const double *w, int stages, double k[][X], double *x) {
  double sum[X];
  for (int i = 0; i < X; i++) sum[i] = 0;
  for (int l = 0; l < stages; l++) {
    double times = w[l];
    if (times == 0) continue;
    for (int i = 0; i < X; i++) sum[i] += times * k[l][i];
  }
  for (int i = 0; i < X; i++) x[i] = sum[i];
}

/* A step of Dopri8 from t to t + h, whose first stage is known unless the state is fresh. */
static void dopri8(double t, double h, const settings *s, state *m, double *error) {
  double x[X];
  if (m->fresh) slope(t, m->y, s, 0, m->k[0]);
  for (int j = 1; j < D_STAGES; j++) {
    combine(D_A + j * D_STAGES, j, m->k, x);
    for (int i = 0; i < X; i++) x[i] = m->y[i] + h * x[i];
    slope(t + D_C[j] * h, x, s, j, m->k[j]);
  }
  combine(D_E, D_STAGES, m->k, error);
  for (int i = 0; i < X; i++) {
    m->z[i] = x[i];
    error[i] *= h;
  }
}

#ifdef STIFF
/* W = I/(h g) - da/dv - h g da/dq in two triangles, with pivots and inverses of the diagonal. */
static void factor(double step, state *m) {
  double *w = m->w;
  for (int i = 0; i < N * N; i++) w[i] = -m->by_v[i] - step * m->by_q[i];
  for (int i = 0; i < N; i++) w[i * N + i] += 1 / step;
  for (int i = 0; i < N; i++) {
    int best = i;
    for (int r = i + 1; r < N; r++)
      if (fabs(w[r * N + i]) > fabs(w[best * N + i])) best = r;
    m->pivot[i] = best;
    for (int c = 0; best != i && c < N; c++) {
      double held = w[i * N + c];
      w[i * N + c] = w[best * N + c];
      w[best * N + c] = held;
    }
    w[i * N + i] = 1 / w[i * N + i];
    for (int r = i + 1; r < N; r++) {
      double times = w[r * N + i] *= w[i * N + i];
      for (int c = i + 1; c < N; c++) w[r * N + c] -= times * w[i * N + c];
    }
  }
}

static void solve(const state *m, double *b) {
  for (int i = 0; i < N; i++) {
    double held = b[i];
    b[i] = b[m->pivot[i]];
    b[m->pivot[i]] = held;
  }
  for (int i = 1; i < N; i++)
    for (int j = 0; j < i; j++) b[i] -= m->w[i * N + j] * b[j];
  for (int i = N - 1; i >= 0; i--) {
    for (int j = i + 1; j < N; j++) b[i] -= m->w[i * N + j] * b[j];
    b[i] *= m->w[i * N + i];
  }
}

/* A step of Rodas5P from t to t + h; the derivatives are known unless the state is fresh. */
static void rodas5p(double t, double h, const settings *s, state *m, double *error) {
  double step = h * R_GAMMA, f[X], right[X], x[X], g[N];
  if (m->fresh)
    model_linear(t, m->y, s->given, m->a, m->by_q, m->by_v,
                 m->by_t KEPT(s->kept + KEPT_LATER));
  factor(step, m);
  for (int j = 0; j < 8; j++) {
    combine(R_A + j * 8, j, m->k, x);
    combine(R_C + j * 8, j, m->k, right);
    for (int i = 0; i < X; i++) {
      x[i] += m->y[i];
      right[i] /= h;
    }
    if (j) slope(t + R_TIMES[j] * h, x, s, j, f);
    for (int i = 0; i < N; i++) {
      right[i] += j ? f[i] : m->y[N + i];
      right[N + i] += (j ? f[N + i] : m->a[i]) + R_SLOPES[j] * h * m->by_t[i];
    }
    for (int i = 0; i < N; i++) {
      double sum = 0;
      for (int l = 0; l < N; l++) sum += m->by_q[i * N + l] * right[l];
      g[i] = right[N + i] + step * sum;
    }
    solve(m, g);
    for (int i = 0; i < N; i++) {
      m->k[j][i] = step * (right[i] + g[i]);
      m->k[j][N + i] = g[i];
    }
  }
  for (int i = 0; i < X; i++) {
    error[i] = m->k[7][i];
    m->z[i] = x[i] + error[i];
  }
}
#endif

/* The end of the run, or the next corner before it; and of a step that should end at `next`. */
static double limited(const settings *s, double t, double next, int kept) {
  double end = s->t1, near;
  for (int i = 0; i < s->corners; i++)
    if (s->corner[i] > t + NEAR_END * EPS * fabs(t) && s->corner[i] < end) end = s->corner[i];
#ifdef LIMITED
  if (s->dt == 0) {
    double longest;
    model_longest(t, s->given, &longest);
    next = smaller(next, t + longest);
  }
#endif
  near = end - NEAR_END * EPS * fabs(end);
  if (next > near) return kept ? end : t + 0.5 * (end - t);
  return next;
}

/* A step from t to `next`, which may reach farther: whether it is kept, and the length of the next
 * one. */
static int attempt(double t, double next, const settings *s, state *m, reach *longer, double *dt,
                   int *status) {
  double h = next - t, error[X + 1], order = s->method == RODAS5P ? 5 : 8, size, factor_;
  int kept;
  *longer = m->so_far;
#ifdef STIFF
  if (s->method == RODAS5P) rodas5p(t, h, s, m, error);
  else
#endif
    dopri8(t, h, s, m, error);
  m->fresh = 0;
  *dt = s->dt;
  if (s->dt != 0) return 1;
  size = scaled(s, longer, m->y, m->z, error, h);
  kept = size < 1;
  factor_ = SAFETY * pow(size, -1 / order);
  factor_ = larger(kept ? 1 : SHORTER, smaller(factor_, kept ? LONGER : SAFETY));
  *dt = h * factor_;
  if (*dt < s->least) *status = NOT_FINITE;
  *dt = larger(*dt, s->least);
  return kept;
}

/* Go on from the end of a step that is kept. */
static void accept(const settings *s, state *m, const reach *longer) {
  for (int i = 0; i < X; i++) m->y[i] = m->z[i];
  /* The last stage of Dopri8 is the first one of the next step. */
  for (int i = 0; i < X && s->method == DOPRI8; i++) m->k[0][i] = m->k[D_STAGES - 1][i];
  m->fresh = s->method == RODAS5P;
  m->so_far = *longer;
}
