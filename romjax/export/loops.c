/* Runs of a model: the steps, their control and the outputs of romjax.simulate.
 *
 * Before this text stand the numbers of the model (N coordinates, FULL physical ones, KIND and
 * FULL_KIND: 1 of positions of bodies), the coefficients of the methods, and the functions
 * model_rate, model_output, model_start and, where they are needed, model_linear, model_flags and
 * model_longest.
 */
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
  double rtol, atol, dt, alpha, beta, t1, least;
  int method, follow, corners;
  int64_t max_steps;
  const double *corner;
} settings;

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

static void slope(double t, const double *x, const settings *s, double *dx) {
  double stabilization[2];
  stabilization[0] = s->alpha;
  stabilization[1] = s->beta;
  for (int i = 0; i < N; i++) dx[i] = x[N + i];
  model_rate(t, x, stabilization, dx + N);
}

/* Tolerances. */

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
      by_q = s->rtol * larger(smaller(r->distance[kind], 1), moved) + noise;
      by_v = s->rtol * larger(smaller(r->speed[kind], 1), fast) + noise / h;
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

/* A step of Dopri8 from t to t + h, whose first stage is known unless the state is fresh. */
static void dopri8(double t, double h, const settings *s, state *m, double *error) {
  double x[X];
  if (m->fresh) slope(t, m->y, s, m->k[0]);
  for (int j = 1; j < D_STAGES; j++) {
    for (int i = 0; i < X; i++) {
      double sum = 0;
      for (int l = 0; l < j; l++) sum += D_A[j * D_STAGES + l] * m->k[l][i];
      x[i] = m->y[i] + h * sum;
    }
    slope(t + D_C[j] * h, x, s, m->k[j]);
  }
  for (int i = 0; i < X; i++) {
    double sum = 0;
    m->z[i] = x[i];
    for (int l = 0; l < D_STAGES; l++) sum += D_E[l] * m->k[l][i];
    error[i] = h * sum;
  }
}

static void dopri8_between(double share, double h, const state *m, double *x) {
  double sum[X];
  for (int i = 0; i < X; i++) sum[i] = 0;
  for (int l = 0; l < D_STAGES; l++) {
    double weight = 0;
    for (int d = 0; d < D_DEGREE; d++) weight = weight * share + D_DENSE[l * D_DEGREE + d];
    weight *= share;
    for (int i = 0; i < X; i++) sum[i] += weight * m->k[l][i];
  }
  for (int i = 0; i < X; i++) x[i] = m->y[i] + h * sum[i];
}

#ifdef STIFF
/* W = I/(h g) - da/dv - h g da/dq in two triangles, with pivots. */
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
    for (int r = i + 1; r < N; r++) {
      double times = w[r * N + i] /= w[i * N + i];
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
    b[i] /= m->w[i * N + i];
  }
}

/* A step of Rodas5P from t to t + h; the derivatives are known unless the state is fresh. */
static void rodas5p(double t, double h, const settings *s, state *m, double *error) {
  double stabilization[2], step = h * R_GAMMA, f[X], right[X], x[X], g[N];
  stabilization[0] = s->alpha;
  stabilization[1] = s->beta;
  if (m->fresh) model_linear(t, m->y, stabilization, m->a, m->by_q, m->by_v, m->by_t);
  factor(step, m);
  for (int j = 0; j < 8; j++) {
    for (int i = 0; i < X; i++) {
      double sum = 0, from = 0;
      for (int l = 0; l < j; l++) {
        sum += R_A[j * 8 + l] * m->k[l][i];
        from += R_C[j * 8 + l] * m->k[l][i];
      }
      x[i] = m->y[i] + sum;
      right[i] = from / h;
    }
    if (j) slope(t + R_TIMES[j] * h, x, s, f);
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

static void rodas5p_between(double share, const state *m, double *x) {
  for (int i = 0; i < X; i++) {
    double d[3] = {0, 0, 0}, rest = 1 - share;
    for (int l = 0; l < 3; l++)
      for (int j = 0; j < 8; j++) d[l] += R_DENSE[l * 8 + j] * m->k[j][i];
    x[i] = rest * m->y[i] + share * (m->z[i] + rest * (d[0] + share * (d[1] + share * d[2])));
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
    model_longest(t, &longest);
    next = smaller(next, t + longest);
  }
#endif
  near = end - NEAR_END * EPS * fabs(end);
  if (next > near) return kept ? end : t + 0.5 * (end - t);
  return next;
}

typedef struct {
  double *q, *v, *x, *violation;
  double extremes[FULL + 1], farthest[FULL + 1], speed[FULL + 1];
  int64_t flags;
  int finite, holds;
} outputs;

static void save(double t, const double *x, const settings *s, outputs *out, int row) {
  double *q = out->q + (size_t)row * FULL, *v = out->v + (size_t)row * FULL, own[2], size = 1;
  for (int i = 0; i < X; i++) {
    out->x[(size_t)row * X + i] = x[i];
    out->finite &= isfinite(x[i]) != 0;
  }
  model_output(t, x, q, v, own);
  out->violation[row] = own[0];
  out->finite &= isfinite(own[0]) != 0;
  for (int i = 0; i < N; i++) size = larger(fabs(x[i]), size);
  if (row == 0) out->extremes[FULL] = size;
  out->holds &= own[1] <= 1e-2 * out->extremes[FULL] + 10 * s->rtol * size;
  for (int i = 0; i < FULL; i++) {
    if (row == 0) out->extremes[i] = out->farthest[i] = out->speed[i] = 0;
    out->extremes[i] = larger(fabs(q[i] - out->q[i]), out->extremes[i]);
    out->farthest[i] = larger(fabs(q[i]), out->farthest[i]);
    out->speed[i] = larger(fabs(v[i]), out->speed[i]);
  }
#ifdef FLAGS
  {
    double flags;
    model_flags(t, x, s->dt == 0 ? s->rtol : 0, &flags);
    out->flags |= (int64_t)flags;
  }
#endif
}

/* Whether the motion is larger than what is tolerated in it, as integrate/resolution.py says. */
static int resolved(const settings *s, const outputs *out, int64_t steps) {
  double sizes[2][2] = {{0, 0}, {0, 0}}, farthest[2] = {1.0, 1e-3}, best = 0;
  int positions = 0, any = 0, fine = 0;
  for (int i = 0; i < FULL; i++) {
    int kind = FULL_KIND[i], moves;
    sizes[0][kind] = larger(out->extremes[i], sizes[0][kind]);
    sizes[1][kind] = larger(out->speed[i], sizes[1][kind]);
    farthest[kind] = larger(out->farthest[i], farthest[kind]);
    moves = out->extremes[i] > 1e-10 * (1 + out->farthest[i]) || out->speed[i] > 1e-10;
    positions |= moves && kind;
  }
  for (int i = 0; i < FULL; i++) {
    int kind = FULL_KIND[i];
    double noise = ROUNDING * EPS * farthest[kind], by_q, by_v, rounding, allowed;
    if (!(out->extremes[i] > 1e-10 * (1 + out->farthest[i]) || out->speed[i] > 1e-10)) continue;
    if (positions && !kind) continue;
    any = 1;
    if (s->follow) {
      by_q = s->rtol * larger(smaller(sizes[0][kind], 1), out->extremes[i]) + noise;
      by_v = s->rtol * larger(smaller(sizes[1][kind], 1), out->speed[i]);
    } else {
      by_q = s->atol + s->rtol * out->farthest[i];
      by_v = s->atol + s->rtol * out->speed[i];
    }
    best = larger(smaller(out->extremes[i] / by_q, out->speed[i] / by_v), best);
    rounding = 0.1 * noise * pow((double)steps, 1.5);
    allowed = larger(100 * larger(s->rtol, 500 * EPS), 2e-7);
    fine |= rounding <= allowed * out->extremes[i];
  }
  if (!any) return 1;
  return s->follow ? fine : best >= smaller(1e-2 / s->rtol, 1e4);
}

/* One run. `numbers`: rtol, atol, dt (0: step size control), alpha, beta; `counts`: method,
 * whether tolerances follow the motion, most steps, corners; `told`: steps, accepted ones, status,
 * flags. Rows that the run does not get to are infinite. */
void model_run(const double *x0, const double *ts, int64_t rows, const double *numbers,
               const int64_t *counts, const double *corner, double *q, double *v, double *x,
               double *violation, int64_t *told) {
  static const double none[1] = {0};
  settings s = {numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], ts[rows - 1], 0,
                (int)counts[0], (int)counts[1], (int)counts[3], counts[2], corner};
  outputs out = {q, v, x, violation, {0}, {0}, {0}, 0, 1, 1};
  state m;
  double t = ts[0], next, good[2], error[X + 1], order = s.method == RODAS5P ? 5 : 8;
  int64_t steps = 0, accepted = 0, row = 0;
  int status = SUCCESS, controlled = s.dt == 0;
  if (!s.corner) s.corner = none;
  for (int i = 0; i < X; i++) m.y[i] = x0[i];
  m.fresh = 1;
  begin(&m.so_far, m.y);
  s.least = 4 * EPS * larger(fabs(ts[0]), fabs(s.t1));
  next = larger(1e-3 * pow(s.rtol, 0.2) * (s.t1 - t), s.least);
  next = limited(&s, t, t + (controlled ? next : s.dt), 1);
  while (t < s.t1 && steps < s.max_steps && status == SUCCESS) {
    double h = next - t, factor_, dt, size;
    int kept = 1;
    reach longer = m.so_far;
#ifdef STIFF
    if (s.method == RODAS5P) rodas5p(t, h, &s, &m, error);
    else
#endif
      dopri8(t, h, &s, &m, error);
    steps++;
    dt = s.dt;
    if (controlled) {
      size = scaled(&s, &longer, m.y, m.z, error, h);
      kept = size < 1;
      factor_ = SAFETY * pow(size, -1 / order);
      factor_ = larger(kept ? 1 : SHORTER, smaller(factor_, kept ? LONGER : SAFETY));
      dt = h * factor_;
      if (dt < s.least) status = NOT_FINITE;
      dt = larger(dt, s.least);
    }
    m.fresh = 0;
    if (kept) {
      while (row < rows && ts[row] <= next) {
        double share = h == 0 ? 0 : (ts[row] - t) / h, at[X + 1];
#ifdef STIFF
        if (s.method == RODAS5P) rodas5p_between(share, &m, at);
        else
#endif
          dopri8_between(share, h, &m, at);
        save(ts[row], at, &s, &out, (int)row);
        row++;
      }
      for (int i = 0; i < X; i++) m.y[i] = m.z[i];
      /* The last stage of Dopri8 is the first one of the next step. */
      for (int i = 0; i < X && s.method == DOPRI8; i++) m.k[0][i] = m.k[D_STAGES - 1][i];
      m.fresh = s.method == RODAS5P;
      m.so_far = longer;
      t = next;
      accepted++;
    }
    next = limited(&s, t, t + dt, kept);
  }
  if (status == SUCCESS && t < s.t1) status = MAX_STEPS;
  for (; row < rows; row++) {
    for (int i = 0; i < FULL; i++) q[row * FULL + i] = v[row * FULL + i] = INFINITY;
    for (int i = 0; i < X; i++) x[row * X + i] = INFINITY;
    violation[row] = INFINITY;
    out.finite = 0;
  }
  if (status == SUCCESS && !out.finite) status = NOT_FINITE;
  if (status == SUCCESS && controlled && HOLDS && !out.holds) status = VIOLATED;
  model_start(ts[0], x0, good);
  if (!(good[0] && good[1])) status = BAD_START;
  if (controlled && !resolved(&s, &out, accepted)) out.flags |= RESOLUTION;
  told[0] = steps;
  told[1] = accepted;
  told[2] = status;
  told[3] = out.flags;
}
