/* A run of one second from the start, or of as long as the first argument says [s].
 *
 * With a second argument it takes fixed steps of that length, by the classical Runge-Kutta method,
 * as a controller would; without it, steps whose error is controlled, by the method of Bogacki and
 * Shampine. Stiff systems need a method for these, with the derivatives that model_f_jvp gives.
 * The outputs go to the standard output, a line for each step.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "model.h"

#define N MODEL_STATES

static const double inputs[MODEL_INPUTS + 1] = {0};

static void f(double t, const double *x, double *dx) {
  model_f(t, x, inputs, model_parameters, dx);
}

static void show(double t, const double *x) {
  double y[MODEL_OUTPUTS];
  model_outputs(t, x, inputs, model_parameters, y);
  printf("%.17g", t);
  for (int i = 0; i < MODEL_OUTPUTS; i++) printf(",%.17g", y[i]);
  printf("\n");
}

/* One step of length h, of fixed cost. */
static void step(double t, double h, double *x) {
  double a[N], b[N], c[N], d[N], z[N];
  f(t, x, a);
  for (int i = 0; i < N; i++) z[i] = x[i] + h / 2 * a[i];
  f(t + h / 2, z, b);
  for (int i = 0; i < N; i++) z[i] = x[i] + h / 2 * b[i];
  f(t + h / 2, z, c);
  for (int i = 0; i < N; i++) z[i] = x[i] + h * c[i];
  f(t + h, z, d);
  for (int i = 0; i < N; i++) x[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
}

/* A step of length h from x to z, and its error over the tolerance. */
static double trial(double t, double h, double tolerance, const double *x, double *z) {
  double a[N], b[N], c[N], d[N], sum = 0;
  f(t, x, a);
  for (int i = 0; i < N; i++) z[i] = x[i] + h / 2 * a[i];
  f(t + h / 2, z, b);
  for (int i = 0; i < N; i++) z[i] = x[i] + 3 * h / 4 * b[i];
  f(t + 3 * h / 4, z, c);
  for (int i = 0; i < N; i++) z[i] = x[i] + h / 9 * (2 * a[i] + 3 * b[i] + 4 * c[i]);
  f(t + h, z, d);
  for (int i = 0; i < N; i++) {
    double error = h / 72 * (-5 * a[i] + 6 * b[i] + 8 * c[i] - 9 * d[i]);
    double share = error / (tolerance * (1 + fabs(z[i])));
    sum += share * share;
  }
  return sqrt(sum / N);
}

int main(int count, char **words) {
  double length = count > 1 ? atof(words[1]) : 1.0, fixed = count > 2 ? atof(words[2]) : 0;
  double t = model_time[0], end = t + length, h = fixed > 0 ? fixed : 1e-4, x[N], z[N];
  long steps = 0;
  for (int i = 0; i < N; i++) x[i] = model_start[i];
  show(t, x);
  while (t < end - 1e-12 * fabs(end)) {
    if (++steps > 10000000 || h < 1e-14 * fabs(end)) {
      fprintf(stderr, "no progress at t = %g s\n", t);
      return 1;
    }
    if (t + h > end) h = end - t;
    if (fixed > 0) {
      step(t, h, x);
    } else {
      double size = trial(t, h, 1e-8, x, z), factor = 0.9 * pow(size, -1.0 / 3);
      int kept = size < 1;
      if (!(factor > 0.2)) factor = 0.2;
      if (factor > 5) factor = 5;
      if (!kept) {
        h *= factor;
        continue;
      }
      for (int i = 0; i < N; i++) x[i] = z[i];
      t += h;
      h *= factor;
      show(t, x);
      continue;
    }
    t += h;
    show(t, x);
  }
  return 0;
}
