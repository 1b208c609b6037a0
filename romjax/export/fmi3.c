/* FMI 3.0 around the steps of a model: model exchange and co-simulation.
 *
 * Before this text stand the numbers of the model (U inputs, P parameters, Y outputs, CORNERS times
 * at which signals have corners, METHOD, TOKEN), and the functions model_rate, model_outputs,
 * model_jvp, model_vjp, model_initial, model_check, model_corners and, where it is needed,
 * model_flags. `given` are the inputs, then the parameters.
 */
#define G (U + P)
/* Value references. */
enum {
  TIME = 0, STATE = 1, RATE = STATE + X, INPUT = RATE + X, PARAMETER = INPUT + U,
  OUTPUT = PARAMETER + P, END = OUTPUT + Y
};
enum {
  INSTANTIATED = 1, INITIALIZATION = 2, EVENT = 4, CONTINUOUS = 8, STEP = 16, TERMINATED = 32
};
#define INITIALIZED (EVENT | CONTINUOUS | STEP | TERMINATED)
#define MOST_STEPS 100000
#define TOLERANCE 1e-6

/* What a state of the FMU keeps. `m.y` is the state of the model, `length` that of the next step,
 * 0 before the first one; `is_set`: states that the importer has set, which parameters leave. */
typedef struct {
  int mode, warned, has_stop, is_set[X];
  double t, stop, rtol, length, size, given[G + 1], corner[CORNERS + 1];
  state m;
} memory;

typedef struct saved {
  struct saved *next;
  memory kept;
} saved;

typedef struct {
  int exchange;
  bool logging;
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback logger;
  saved *states;
  memory now;
} instance;

static fmi3Status say(const instance *c, fmi3Status status, const char *where, const char *what) {
  char words[400];
  snprintf(words, sizeof words, "%s: %s.", where, what);
  if (c->logging && c->logger)
    c->logger(c->environment, status, status == fmi3Error ? "logStatusError" : "logStatusWarning",
              words);
  return status;
}

#define FAIL(what) return say(c, fmi3Error, __func__, what)
#define IN(modes)                                                                           \
  instance *c = pointer;                                                                    \
  if (!c) return fmi3Error;                                                                 \
  if (!(c->now.mode & (modes))) FAIL("it is not allowed in the mode that the instance is in")

/* What follows from numbers that are given: corners of signals, and before the first step states
 * that nobody has set. */
static void follow(memory *m) {
  double start[X];
  model_corners(m->given, m->corner);
  m->m.fresh = 1;
  if (!(m->mode & (INSTANTIATED | INITIALIZATION))) return;
  model_initial(m->given, start);
  for (int i = 0; i < X; i++)
    if (!m->is_set[i]) m->m.y[i] = start[i];
}

static void restart(memory *m) {
  memset(m, 0, sizeof *m);
  m->mode = INSTANTIATED;
  m->rtol = TOLERANCE;
  for (int i = 0; i < P; i++) m->given[U + i] = PARAMETERS[i];
  follow(m);
}

static instance *make(int exchange, fmi3String token, bool logging, fmi3InstanceEnvironment where,
                      fmi3LogMessageCallback logger, bool events) {
  instance *c = calloc(1, sizeof *c), told = {0};
  told.logging = logging;
  told.environment = where;
  told.logger = logger;
  if (!c) {
    say(&told, fmi3Error, "instantiate", "there is no memory left");
    return NULL;
  }
  *c = told;
  c->exchange = exchange;
  if (!token || strcmp(token, TOKEN)) {
    say(c, fmi3Error, "instantiate", "the instantiation token is not that of this model");
  } else if (events) {
    say(c, fmi3Error, "instantiate", "this model has no event mode in co-simulation");
  } else {
    restart(&c->now);
    return c;
  }
  free(c);
  return NULL;
}

API const char *fmi3GetVersion(void) { return "3.0"; }

API fmi3Status fmi3SetDebugLogging(fmi3Instance pointer, fmi3Boolean on, size_t n,
                                   const fmi3String categories[]) {
  IN(~0);
  if (n && !categories) FAIL("categories are missing");
  for (size_t i = 0; i < n; i++)
    if (!categories[i] ||
        (strcmp(categories[i], "logStatusError") && strcmp(categories[i], "logStatusWarning")))
      FAIL("there is no such category of messages");
  c->logging = on;
  return fmi3OK;
}

API fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String folder,
                                              fmi3Boolean visible, fmi3Boolean logging,
                                              fmi3InstanceEnvironment environment,
                                              fmi3LogMessageCallback logger) {
  return make(1, token, logging, environment, logger, false);
}

API fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String folder, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference intermediate[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
    fmi3IntermediateUpdateCallback update) {
  return make(0, token, logging, environment, logger, events);
}

API void fmi3FreeInstance(fmi3Instance pointer) {
  instance *c = pointer;
  while (c && c->states) {
    saved *first = c->states;
    c->states = first->next;
    free(first);
  }
  free(c);
}

API fmi3Status fmi3Reset(fmi3Instance pointer) {
  IN(~0);
  restart(&c->now);
  return fmi3OK;
}

/* From one mode to the next. */

API fmi3Status fmi3EnterInitializationMode(fmi3Instance pointer, fmi3Boolean has_tolerance,
                                           fmi3Float64 tolerance, fmi3Float64 start,
                                           fmi3Boolean has_stop, fmi3Float64 stop) {
  IN(INSTANTIATED);
  if (has_tolerance && !(tolerance > 0 && tolerance < 1)) FAIL("the tolerance is not within 0, 1");
  if (!isfinite(start)) FAIL("the start time is not finite");
  if (has_stop && !(isfinite(stop) && stop > start)) FAIL("the stop time is not after the start");
  c->now.rtol = has_tolerance ? larger(tolerance, 50 * EPS) : TOLERANCE;
  c->now.t = start;
  c->now.has_stop = has_stop;
  c->now.stop = stop;
  c->now.mode = INITIALIZATION;
  return fmi3OK;
}

API fmi3Status fmi3ExitInitializationMode(fmi3Instance pointer) {
  double good[4];
  IN(INITIALIZATION);
  model_check(c->now.t, c->now.m.y, c->now.given, good);
  if (!(good[0] && good[1]))
    FAIL("the start violates the constraints; set states, or parameters, that fit each other");
  begin(&c->now.m.so_far, c->now.m.y);
  c->now.size = 1;
  for (int i = 0; i < N; i++) c->now.size = larger(fabs(c->now.m.y[i]), c->now.size);
  c->now.size = smaller(good[3], c->now.size);
  c->now.mode = c->exchange ? EVENT : STEP;
  return fmi3OK;
}

API fmi3Status fmi3EnterEventMode(fmi3Instance pointer) {
  IN(CONTINUOUS);
  c->now.mode = EVENT;
  return fmi3OK;
}

API fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance pointer) {
  IN(EVENT);
  c->now.mode = CONTINUOUS;
  return fmi3OK;
}

API fmi3Status fmi3Terminate(fmi3Instance pointer) {
  IN(EVENT | CONTINUOUS | STEP);
  c->now.mode = TERMINATED;
  return fmi3OK;
}

/* At a corner of a signal steps have to end. */
API fmi3Status fmi3UpdateDiscreteStates(fmi3Instance pointer, fmi3Boolean *update,
                                        fmi3Boolean *terminate, fmi3Boolean *nominals,
                                        fmi3Boolean *states, fmi3Boolean *has_next,
                                        fmi3Float64 *next) {
  IN(EVENT);
  if (!update || !terminate || !nominals || !states || !has_next || !next)
    FAIL("a result is missing");
  *update = *terminate = *nominals = *states = false;
  *next = INFINITY;
  for (int i = 0; i < CORNERS; i++)
    if (c->now.corner[i] > c->now.t + NEAR_END * EPS * fabs(c->now.t))
      *next = smaller(c->now.corner[i], *next);
  *has_next = isfinite(*next);
  if (!*has_next) *next = c->now.t;
  return fmi3OK;
}

/* Numbers by their references. */

API fmi3Status fmi3GetFloat64(fmi3Instance pointer, const fmi3ValueReference names[], size_t n,
                              fmi3Float64 values[], size_t count) {
  double rates[X], outputs[Y + 1];
  int has_rates = 0, has_outputs = 0;
  IN(INITIALIZATION | INITIALIZED);
  if (n != count || (n && !(names && values))) FAIL("there are not as many values as references");
  for (size_t i = 0; i < n; i++) {
    fmi3ValueReference r = names[i];
    if (r >= END) FAIL("there is no such variable");
    has_rates |= r >= RATE && r < INPUT;
    has_outputs |= r >= OUTPUT;
  }
  if (has_rates) {
    for (int i = 0; i < N; i++) rates[i] = c->now.m.y[N + i];
    model_rate(c->now.t, c->now.m.y, c->now.given, rates + N);
  }
  if (has_outputs) model_outputs(c->now.t, c->now.m.y, c->now.given, outputs);
  for (size_t i = 0; i < n; i++) {
    fmi3ValueReference r = names[i];
    if (r == TIME) values[i] = c->now.t;
    else if (r < RATE) values[i] = c->now.m.y[r - STATE];
    else if (r < INPUT) values[i] = rates[r - RATE];
    else if (r < OUTPUT) values[i] = c->now.given[r - INPUT];
    else values[i] = outputs[r - OUTPUT];
  }
  return fmi3OK;
}

API fmi3Status fmi3SetFloat64(fmi3Instance pointer, const fmi3ValueReference names[], size_t n,
                              const fmi3Float64 values[], size_t count) {
  IN(INSTANTIATED | INITIALIZATION | EVENT | CONTINUOUS | STEP);
  /* In model exchange importers set states by this function, too, and parameters at any time. */
  int may_start = c->exchange || c->now.mode & (INSTANTIATED | INITIALIZATION), changed = 0;
  if (n != count || (n && !(names && values))) FAIL("there are not as many values as references");
  for (size_t i = 0; i < n; i++) {
    fmi3ValueReference r = names[i];
    if (r >= END) FAIL("there is no such variable");
    if (r < STATE || (r >= RATE && r < INPUT) || r >= OUTPUT)
      FAIL("time, derivatives and outputs cannot be set");
    if (r < RATE && !may_start) FAIL("states have their values from before the start");
    if (!isfinite(values[i])) FAIL("a value is not finite");
  }
  for (size_t i = 0; i < n; i++) {
    fmi3ValueReference r = names[i];
    if (r < RATE) {
      c->now.m.y[r - STATE] = values[i];
      c->now.is_set[r - STATE] = 1;
    } else {
      changed |= c->now.given[r - INPUT] != values[i];
      c->now.given[r - INPUT] = values[i];
    }
  }
  if (changed) follow(&c->now);
  return fmi3OK;
}

/* Derivatives. Unknowns are derivatives of states and outputs, of which some are states; knowns are
 * states, inputs and parameters. */

static int is_unknown(fmi3ValueReference r) {
  return (r >= STATE && r < INPUT) || (r >= OUTPUT && r < END);
}

static int is_known(fmi3ValueReference r) {
  return (r >= STATE && r < RATE) || (r >= INPUT && r < OUTPUT);
}

static fmi3Status checked(const instance *c, const char *where, const fmi3ValueReference unknowns[],
                          size_t n, const fmi3ValueReference knowns[], size_t k, int fits) {
  if (!fits) return say(c, fmi3Error, where, "there are not as many numbers as variables");
  for (size_t i = 0; i < n; i++)
    if (!is_unknown(unknowns[i]))
      return say(c, fmi3Error, where, "an unknown is no output and no derivative of a state");
  for (size_t i = 0; i < k; i++)
    if (!is_known(knowns[i]))
      return say(c, fmi3Error, where, "a known is no state, no input and no parameter");
  return fmi3OK;
}

API fmi3Status fmi3GetDirectionalDerivative(fmi3Instance pointer,
                                            const fmi3ValueReference unknowns[], size_t n,
                                            const fmi3ValueReference knowns[], size_t k,
                                            const fmi3Float64 seed[], size_t seeds,
                                            fmi3Float64 sensitivity[], size_t sensitivities) {
  double vx[X] = {0}, vs[G + 1] = {0}, dx[X], dy[Y + 1];
  IN(INITIALIZATION | INITIALIZED);
  int there = (!n || (unknowns && sensitivity)) && (!k || (knowns && seed));
  int fits = there && seeds == k && sensitivities == n;
  if (checked(c, __func__, unknowns, n, knowns, k, fits)) return fmi3Error;
  for (size_t i = 0; i < k; i++) {
    if (knowns[i] < RATE) vx[knowns[i] - STATE] += seed[i];
    else vs[knowns[i] - INPUT] += seed[i];
  }
  model_jvp(c->now.t, c->now.m.y, c->now.given, vx, vs, dx, dy);
  for (size_t i = 0; i < n; i++) {
    fmi3ValueReference r = unknowns[i];
    if (r < RATE) sensitivity[i] = vx[r - STATE];
    else sensitivity[i] = r < INPUT ? dx[r - RATE] : dy[r - OUTPUT];
  }
  return fmi3OK;
}

API fmi3Status fmi3GetAdjointDerivative(fmi3Instance pointer, const fmi3ValueReference unknowns[],
                                        size_t n, const fmi3ValueReference knowns[], size_t k,
                                        const fmi3Float64 seed[], size_t seeds,
                                        fmi3Float64 sensitivity[], size_t sensitivities) {
  double own[X] = {0}, wx[X] = {0}, wy[Y + 1] = {0}, bx[X], bs[G + 1];
  IN(INITIALIZATION | INITIALIZED);
  int there = (!n || (unknowns && seed)) && (!k || (knowns && sensitivity));
  int fits = there && seeds == n && sensitivities == k;
  if (checked(c, __func__, unknowns, n, knowns, k, fits)) return fmi3Error;
  for (size_t i = 0; i < n; i++) {
    fmi3ValueReference r = unknowns[i];
    if (r < RATE) own[r - STATE] += seed[i];
    else if (r < INPUT) wx[r - RATE] += seed[i];
    else wy[r - OUTPUT] += seed[i];
  }
  model_vjp(c->now.t, c->now.m.y, c->now.given, wx, wy, bx, bs);
  for (size_t i = 0; i < k; i++) {
    fmi3ValueReference r = knowns[i];
    sensitivity[i] = r < RATE ? own[r - STATE] + bx[r - STATE] : bs[r - INPUT];
  }
  return fmi3OK;
}
