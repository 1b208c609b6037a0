/* The model as external functions of CasADi, with derivatives in both modes:
 *
 *   cc -O2 -std=c99 -fPIC -shared -o libcasadi_model.so casadi.c model.c -lm
 *   f = casadi.external("model_rates", "./libcasadi_model.so")
 *   y = casadi.external("model_measured", "./libcasadi_model.so")
 *
 * Both are functions of t, x, u and p. Time has no derivative here: what CasADi asks for by t is
 * not a number.
 */
#include <math.h>
#include <stddef.h>

#include "model.h"

#define X MODEL_STATES
#define U MODEL_INPUTS
#define P MODEL_PARAMETERS
#define Y MODEL_OUTPUTS
#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API
#endif

/* Of t, x, u and p: {rows, columns, 1 for a dense matrix}. */
static const long long in[4][3] = {{1, 1, 1}, {X, 1, 1}, {U, 1, 1}, {P, 1, 1}};

/* CasADi leaves out what is zero. */
static const double *numbers(const double *given, double *room, int count) {
  if (given) return given;
  for (int i = 0; i < count; i++) room[i] = 0;
  return room;
}

#define POINT                                                                \
  double zx[X + 1], zu[U + 1], zp[P + 1];                                    \
  const double t = arg[0] ? *arg[0] : 0, *x = numbers(arg[1], zx, X);        \
  const double *u = numbers(arg[2], zu, U), *p = numbers(arg[3], zp, P);     \
  (void)iw, (void)w, (void)mem;

#define SHAPES(name, inputs, outputs, shape_in, shape_out)                                  \
  API long long name##_n_in(void) { return inputs; }                                        \
  API long long name##_n_out(void) { return outputs; }                                      \
  API const long long *name##_sparsity_in(long long i) { return shape_in; }                 \
  API const long long *name##_sparsity_out(long long i) {                                    \
    (void)i;                                                                                \
    return shape_out;                                                                       \
  }                                                                                         \
  API int name##_work(long long *args, long long *res, long long *iw, long long *w) {       \
    *args = inputs;                                                                         \
    *res = outputs;                                                                         \
    *iw = *w = 0;                                                                           \
    return 0;                                                                               \
  }

/* A function, its derivatives along directions (of the arguments, the result and the directions),
 * and adjoint ones (of the arguments, the result and its weights). */
#define EXTERNAL(name, function, count)                                                     \
  static const long long out_##name[3] = {count, 1, 1};                                     \
  SHAPES(name, 4, 1, in[i], out_##name)                                                     \
  API int name(const double **arg, double **res, long long *iw, double *w, int mem) {       \
    POINT                                                                                   \
    if (res[0]) function(t, x, u, p, res[0]);                                               \
    return 0;                                                                               \
  }                                                                                         \
  SHAPES(fwd1_##name, 9, 1, i < 4 ? in[i] : i == 4 ? out_##name : in[i - 5], out_##name)    \
  API int fwd1_##name(const double **arg, double **res, long long *iw, double *w, int mem) { \
    POINT                                                                                   \
    double vx[X + 1], vu[U + 1], vp[P + 1];                                                 \
    if (!res[0]) return 0;                                                                  \
    function##_jvp(t, x, u, p, numbers(arg[6], vx, X), numbers(arg[7], vu, U),              \
                   numbers(arg[8], vp, P), res[0]);                                         \
    for (int i = 0; arg[5] && *arg[5] != 0 && i < count; i++) res[0][i] = NAN;              \
    return 0;                                                                               \
  }                                                                                         \
  SHAPES(adj1_##name, 6, 4, i < 4 ? in[i] : out_##name, in[i])                              \
  API int adj1_##name(const double **arg, double **res, long long *iw, double *w, int mem) { \
    POINT                                                                                   \
    double room[count + 1], wx[X + 1], wu[U + 1], wp[P + 1];                                \
    if (res[0]) res[0][0] = NAN;                                                            \
    function##_vjp(t, x, u, p, numbers(arg[5], room, count), res[1] ? res[1] : wx,          \
                   res[2] ? res[2] : wu, res[3] ? res[3] : wp);                             \
    return 0;                                                                               \
  }

EXTERNAL(model_rates, model_f, X)
EXTERNAL(model_measured, model_outputs, Y)
