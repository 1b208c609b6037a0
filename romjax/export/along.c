/* Derivatives of a run along directions: those of each step that is kept, with its length held. */
#ifdef ALONG
typedef struct {
  double y[X], z[X], k[STAGES][X], a[N], by_q[N * N], by_v[N * N], by_t[N];
} tangent;

static void slope_along(double t, const double *x, const settings *s, const double *along,
                        const double *given, double *dx) {
  for (int i = 0; i < N; i++) dx[i] = along[N + i];
  model_rate_jvp(t, x, s->given, along, given, dx + N);
}

static tangent *begin_along(const directions *along, const settings *s, const state *m, double t,
                            int own) {
  tangent *d = calloc((size_t)along->count + 1, sizeof *d);
  for (int64_t l = 0; d && l < along->count; l++) {
    double start[X];
    model_initial_jvp(s->given, along->given[l], start);
    for (int i = 0; i < X; i++)
      d[l].y[i] = own & (i < N ? 1 : 2) ? start[i] : along->start[l][i];
    if (s->method == DOPRI8) slope_along(t, m->y, s, d[l].y, along->given[l], d[l].k[0]);
  }
  return d;
}

static void dopri8_along(const directions *along, double t, double h, const settings *s,
                         state *m, tangent *d) {
  double x[X], dx[X];
  for (int j = 1; j < D_STAGES; j++) {
    combine(D_A + j * D_STAGES, j, m->k, x);
    for (int i = 0; i < X; i++) x[i] = m->y[i] + h * x[i];
    for (int64_t c = 0; c < along->count; c++) {
      combine(D_A + j * D_STAGES, j, d[c].k, dx);
      for (int i = 0; i < X; i++) d[c].z[i] = dx[i] = d[c].y[i] + h * dx[i];
      slope_along(t + D_C[j] * h, x, s, dx, along->given[c], d[c].k[j]);
    }
  }
}

#ifdef STIFF
/* The derivative of W g = b is W dg = db - dW g. */
static void rodas5p_along(const directions *along, double t, double h, const settings *s,
                          state *m, tangent *d) {
  double step = h * R_GAMMA, x[X], dx[X], f[X], right[X], g[N];
  for (int64_t c = 0; c < along->count; c++)
    model_linear_jvp(t, m->y, s->given, d[c].y, along->given[c], d[c].a, d[c].by_q, d[c].by_v,
                     d[c].by_t);
  for (int j = 0; j < 8; j++) {
    combine(R_A + j * 8, j, m->k, x);
    for (int i = 0; i < X; i++) x[i] += m->y[i];
    for (int64_t c = 0; c < along->count; c++) {
      combine(R_A + j * 8, j, d[c].k, dx);
      combine(R_C + j * 8, j, d[c].k, right);
      for (int i = 0; i < X; i++) {
        dx[i] += d[c].y[i];
        right[i] /= h;
      }
      if (j) slope_along(t + R_TIMES[j] * h, x, s, dx, along->given[c], f);
      for (int i = 0; i < N; i++) {
        right[i] += j ? f[i] : d[c].y[N + i];
        right[N + i] += (j ? f[N + i] : d[c].a[i]) + R_SLOPES[j] * h * d[c].by_t[i];
      }
      for (int i = 0; i < N; i++) {
        double sum = 0;
        for (int l = 0; l < N; l++) {
          double own = m->k[j][N + l];
          sum += m->by_q[i * N + l] * right[l] + d[c].by_q[i * N + l] * m->k[j][l] / step;
          g[i] = own * d[c].by_v[i * N + l] + (l ? g[i] : 0);
        }
        g[i] += right[N + i] + step * sum;
      }
      solve(m, g);
      for (int i = 0; i < N; i++) {
        d[c].k[j][i] = step * (right[i] + g[i]);
        d[c].k[j][N + i] = g[i];
      }
      for (int i = 0; j == 7 && i < X; i++) d[c].z[i] = dx[i] + d[c].k[j][i];
    }
  }
}
#endif

static void step_along(const directions *along, double t, double h, const settings *s, state *m,
                       tangent *d) {
#ifdef STIFF
  if (s->method == RODAS5P) {
    rodas5p_along(along, t, h, s, m, d);
    return;
  }
#endif
  dopri8_along(along, t, h, s, m, d);
}

static void save_along(const directions *along, double t, double share, double h, const double *x,
                       const settings *s, tangent *d, int64_t row) {
  for (int64_t c = 0; c < along->count; c++) {
    double *dx = along->x[c] + row * X;
    between(s, share, h, d[c].y, d[c].z, d[c].k, dx);
    model_output_jvp(t, x, s->given, dx, along->given[c], along->q[c] + row * FULL,
                     along->v[c] + row * FULL);
  }
}

static void accept_along(const directions *along, const settings *s, tangent *d) {
  for (int64_t c = 0; c < along->count; c++)
    for (int i = 0; i < X; i++) {
      d[c].y[i] = d[c].z[i];
      if (s->method == DOPRI8) d[c].k[0][i] = d[c].k[D_STAGES - 1][i];
    }
}

static void end_along(const directions *along, int64_t row, int64_t rows, tangent *d) {
  for (int64_t c = 0; c < along->count; c++) {
    for (int64_t i = row * FULL; i < rows * FULL; i++) along->q[c][i] = along->v[c][i] = 0;
    for (int64_t i = row * X; i < rows * X; i++) along->x[c][i] = 0;
  }
  free(d);
}
#endif

