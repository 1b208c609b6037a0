/* Runs of a model with the outputs of romjax.simulate, by the steps before this text.
 *
 * Further numbers are FULL physical coordinates, FULL_KIND: 1 of positions of bodies, and further
 * functions model_output, model_start and, where it is needed, model_flags.
 */
/* How much each stage of Dopri8 counts at a share of a step; those of Rodas5P are used as they are.
 */
static void weigh(const settings *s, double share, double *weight) {
  for (int l = 0; l < D_STAGES; l++) weight[l] = 0;
  if (s->method == RODAS5P) return;
  for (int d = 0; d < D_DEGREE; d++)
    for (int l = 0; l < D_STAGES; l++) weight[l] = weight[l] * share + D_DENSE[d * D_STAGES + l];
  for (int l = 0; l < D_STAGES; l++) weight[l] *= share;
}

#ifdef STIFF
static void rodas5p_between(double share, const double *y, const double *z, double k[][X],
                            double *x) {
  for (int i = 0; i < X; i++) {
    double d[3] = {0, 0, 0}, rest = 1 - share;
    for (int l = 0; l < 3; l++)
      for (int j = 0; j < 8; j++) d[l] += R_DENSE[l * 8 + j] * k[j][i];
    x[i] = rest * y[i] + share * (z[i] + rest * (d[0] + share * (d[1] + share * d[2])));
  }
}
#endif

/* A state within a step, by that before it, that after it and its stages; or its derivative. */
static void between(const settings *s, const double *weight, double share, double h,
                    const double *y, const double *z, double k[][X], double *x) {
#ifdef STIFF
  if (s->method == RODAS5P) {
    rodas5p_between(share, y, z, k, x);
    return;
  }
#endif
  (void)s;
  (void)share;
  (void)z;
  combine(weight, D_STAGES, k, x);
  for (int i = 0; i < X; i++) x[i] = y[i] + h * x[i];
}

/* Derivatives of a run along directions: how many, those of the start and of the parameters, for
 * each of them where q, v and x go, and room for them. */
typedef struct {
  int64_t count;
  const double *const *start, *const *given;
  double *const *q, *const *v, *const *x, *room;
} directions;

/* ALONG */
typedef struct {
  double *q, *v, *x, *violation;
  double extremes[FULL + 1], farthest[FULL + 1], speed[FULL + 1];
  int64_t flags;
  int finite, holds;
  double apart;
} outputs;

static void save(double t, const double *x, const settings *s, outputs *out, int row) {
  double *q = out->q + (size_t)row * FULL, *v = out->v + (size_t)row * FULL, own[2], size = 1;
  for (int i = 0; i < X; i++) {
    out->x[(size_t)row * X + i] = x[i];
    out->finite &= isfinite(x[i]) != 0;
  }
  model_output(t, x, s->given, q, v, own KEPT(s->kept + KEPT_AT_OUTPUT));
  out->violation[row] = own[0];
  out->finite &= isfinite(own[0]) != 0;
  for (int i = 0; i < N; i++) size = larger(fabs(x[i]), size);
  if (row == 0) out->extremes[FULL] = smaller(size, out->apart);
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
    model_flags(t, x, s->given, s->dt == 0 ? s->rtol : 0, &flags);
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

static void begin_run(const double *x0, const settings *s, int own, double *y) {
  double start[X];
  model_initial(s->given, start KEPT(s->kept + KEPT_AT_INITIAL));
  for (int i = 0; i < X; i++) y[i] = own & (i < N ? 1 : 2) ? start[i] : x0[i];
}

/* One run. `given`: alpha, beta, parameters; `numbers`: rtol, atol, dt (0: step size control);
 * `counts`: method, whether tolerances follow the motion, most steps, and whether the positions (1)
 * and velocities (2) at the start are those of the parameters; `told`: steps, accepted ones,
 * status, flags. Rows that the run does not get to are NaN. Libraries with derivatives always
 * get directions; others get NULL. */
void model_run(const double *x0, const double *given, const double *ts, int64_t rows,
               const double *numbers, const int64_t *counts, double *q, double *v, double *x,
               double *violation, int64_t *told, const directions *along) {
  double corner[CORNERS + 1], t = ts[0], next, good[2], apart, turning;
  int controlled = numbers[2] == 0, status = SUCCESS;
  settings s = {numbers[0], numbers[1], numbers[2], ts[rows - 1], 0, (int)counts[0],
                (int)counts[1], controlled ? CORNERS : 0, counts[2], corner, given,
                along ? along->room : NULL, numbers[0]};
  outputs out = {q, v, x, violation, {0}, {0}, {0}, 0, 1, 1, 1};
  state m;
  int64_t steps = 0, accepted = 0, row = 0;
  model_corners(given, corner);
  begin_run(x0, &s, (int)counts[3], m.y);
  model_start(t, m.y, given, good, &apart, &turning);
  out.apart = apart;
  if (s.follow) s.fine = turning_rtol(&s, turning, s.t1 - t);
  m.fresh = 1;
#ifdef ALONG
  slope(t, m.y, &s, 0, m.k[0]);
  m.fresh = s.method == RODAS5P;
  tangent *d = begin_along(along, &s, (int)counts[3]);
#endif
  begin(&m.so_far, m.y);
  s.least = 4 * EPS * larger(fabs(ts[0]), fabs(s.t1));
  next = larger(1e-3 * pow(s.fine, 0.2) * (s.t1 - t), s.least);
  next = limited(&s, t, t + (controlled ? next : s.dt), 1);
  while (t < s.t1 && steps < s.max_steps && status == SUCCESS) {
    double h = next - t, dt;
    reach longer;
    int kept = attempt(t, next, &s, &m, &longer, &dt, &status);
    steps++;
    if (kept) {
#ifdef ALONG
      step_along(along, h, &s, &m, d);
#endif
      while (row < rows && ts[row] <= next) {
        double share = h == 0 ? 0 : (ts[row] - t) / h, at[X + 1], weight[D_STAGES];
        weigh(&s, share, weight);
        between(&s, weight, share, h, m.y, m.z, m.k, at);
        save(ts[row], at, &s, &out, (int)row);
#ifdef ALONG
        save_along(along, weight, share, h, &s, d, row);
#endif
        row++;
      }
#ifdef ALONG
      accept_along(along, &s, d);
#endif
      accept(&s, &m, &longer);
      t = next;
      accepted++;
    }
    next = limited(&s, t, t + dt, kept);
  }
  if (status == SUCCESS && t < s.t1) status = MAX_STEPS;
#ifdef ALONG
  end_along(along, row, rows);
#endif
  for (; row < rows; row++) {
    for (int i = 0; i < FULL; i++) q[row * FULL + i] = v[row * FULL + i] = NAN;
    for (int i = 0; i < X; i++) x[row * X + i] = NAN;
    violation[row] = NAN;
    out.finite = 0;
  }
  if (status == SUCCESS && !out.finite) status = NOT_FINITE;
  if (status == SUCCESS && controlled && HOLDS && !out.holds) status = VIOLATED;
  if (!(good[0] && good[1])) status = BAD_START;
  if (controlled && !resolved(&s, &out, accepted)) out.flags |= RESOLUTION;
  told[0] = steps;
  told[1] = accepted;
  told[2] = status;
  told[3] = out.flags;
}
