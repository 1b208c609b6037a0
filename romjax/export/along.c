/* Derivatives of a run along directions: those of each step that is kept, with its length held. */
#ifdef ALONG
typedef struct {
  double y[X], z[X], k[STAGES][X], a[N], by_q[N * N], by_v[N * N], by_t[N];
} tangent;

/* Places of what is kept after the rates. */
#ifdef STIFF
#define KEPT_AT_OUTPUT (KEPT_LATER + KEPT_LINEAR)
#else
#define KEPT_AT_OUTPUT KEPT_LATER
#endif
#define KEPT_AT_INITIAL (KEPT_AT_OUTPUT + KEPT_OUTPUT)

/* How many numbers there must be room for. */
static size_t room_along(int64_t count) {
  return (size_t)(KEPT_AT_INITIAL + KEPT_INITIAL) + (size_t)count * sizeof(tangent) / 8;
}

static void slope_along(const settings *s, int stage, const double *along, const double *given,
                        double *dx) {
  for (int i = 0; i < N; i++) dx[i] = along[N + i];
  model_rate_jvp(s->kept + stage * KEPT_RATE, along, given, dx + N);
}

/* At the start, where the first stage of Dopri8 is known. */
static tangent *begin_along(const directions *along, const settings *s, int own) {
  tangent *d = (tangent *)(along->room + KEPT_AT_INITIAL + KEPT_INITIAL);
  for (int64_t l = 0; l < along->count; l++) {
    double start[X];
    model_initial_jvp(s->kept + KEPT_AT_INITIAL, along->given[l], start);
    for (int i = 0; i < X; i++)
      d[l].y[i] = own & (i < N ? 1 : 2) ? start[i] : along->start[l][i];
    if (s->method == DOPRI8) slope_along(s, 0, d[l].y, along->given[l], d[l].k[0]);
  }
  return d;
}

static void dopri8_along(const directions *along, double h, const settings *s, tangent *d) {
  double dx[X];
  for (int j = 1; j < D_STAGES; j++)
    for (int64_t c = 0; c < along->count; c++) {
      combine(D_A + j * D_STAGES, j, d[c].k, dx);
      for (int i = 0; i < X; i++) d[c].z[i] = dx[i] = d[c].y[i] + h * dx[i];
      slope_along(s, j, dx, along->given[c], d[c].k[j]);
    }
}

#ifdef STIFF
/* The derivative of W g = b is W dg = db - dW g. */
static void rodas5p_along(const directions *along, double h, const settings *s, const state *m,
                          tangent *d) {
  double step = h * R_GAMMA, dx[X], f[X], right[X], g[N];
  for (int64_t c = 0; c < along->count; c++) {
    model_linear_jvp(s->kept + KEPT_LATER, d[c].y, along->given[c], d[c].a, d[c].by_q, d[c].by_v,
                     d[c].by_t);
    for (int j = 0; j < 8; j++) {
      combine(R_A + j * 8, j, d[c].k, dx);
      combine(R_C + j * 8, j, d[c].k, right);
      for (int i = 0; i < X; i++) {
        dx[i] += d[c].y[i];
        right[i] /= h;
      }
      if (j) slope_along(s, j, dx, along->given[c], f);
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

static void step_along(const directions *along, double h, const settings *s, const state *m,
                       tangent *d) {
#ifdef STIFF
  if (s->method == RODAS5P) {
    rodas5p_along(along, h, s, m, d);
    return;
  }
#endif
  (void)m;
  dopri8_along(along, h, s, d);
}

/* After the run itself has saved a row. */
static void save_along(const directions *along, const double *weight, double share, double h,
                       const settings *s, tangent *d, int64_t row) {
  for (int64_t c = 0; c < along->count; c++) {
    double *dx = along->x[c] + row * X;
    between(s, weight, share, h, d[c].y, d[c].z, d[c].k, dx);
    model_output_jvp(s->kept + KEPT_AT_OUTPUT, dx, along->given[c], along->q[c] + row * FULL,
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

/* Rows that the run does not get to. */
static void end_along(const directions *along, int64_t row, int64_t rows) {
  for (int64_t c = 0; c < along->count; c++) {
    for (int64_t i = row * FULL; i < rows * FULL; i++) along->q[c][i] = along->v[c][i] = NAN;
    for (int64_t i = row * X; i < rows * X; i++) along->x[c][i] = NAN;
  }
}
#endif

