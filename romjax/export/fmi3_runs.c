/* Model exchange, co-simulation, and states that are kept. */

/* Whether the region of validity of a reduced model says no, told once. */
static fmi3Status doubted(instance *c, const char *where) {
#ifdef FLAGS
  double flags = 0;
  if (!c->now.warned) model_flags(c->now.t, c->now.m.y, c->now.given, c->now.rtol, &flags);
  if (flags) {
    c->now.warned = 1;
    return say(c, fmi3Warning, where, "the motion leaves what the reduced model was made of");
  }
#endif
  (void)c;
  (void)where;
  return fmi3OK;
}

/* Model exchange. */

API fmi3Status fmi3SetTime(fmi3Instance pointer, fmi3Float64 time) {
  IN(CONTINUOUS);
  if (!isfinite(time)) FAIL("the time is not finite");
  c->now.t = time;
  return fmi3OK;
}

API fmi3Status fmi3SetContinuousStates(fmi3Instance pointer, const fmi3Float64 x[], size_t n) {
  IN(CONTINUOUS);
  if (n != X || !x) FAIL("the number of states is another one");
  memcpy(c->now.m.y, x, sizeof c->now.m.y);
  return fmi3OK;
}

#define EXCHANGED(result)                                            \
  IN(INITIALIZATION | INITIALIZED);                                  \
  if (!c->exchange) FAIL("it is part of model exchange");            \
  if (n != X || !result) FAIL("the number of states is another one")

API fmi3Status fmi3GetContinuousStates(fmi3Instance pointer, fmi3Float64 x[], size_t n) {
  EXCHANGED(x);
  memcpy(x, c->now.m.y, sizeof c->now.m.y);
  return fmi3OK;
}

API fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance pointer, fmi3Float64 dx[], size_t n) {
  EXCHANGED(dx);
  for (int i = 0; i < N; i++) dx[i] = c->now.m.y[N + i];
  model_rate(c->now.t, c->now.m.y, c->now.given, dx + N);
  for (int i = 0; i < X; i++)
    if (!isfinite(dx[i])) return say(c, fmi3Discard, __func__, "a derivative is not finite");
  return fmi3OK;
}

API fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance pointer, fmi3Float64 x[], size_t n) {
  EXCHANGED(x);
  for (int i = 0; i < X; i++) x[i] = 1;
  return fmi3OK;
}

API fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance pointer, size_t *n) {
  IN(~0);
  if (!c->exchange || !n) FAIL("it is part of model exchange, and returns a number");
  *n = X;
  return fmi3OK;
}

API fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance pointer, size_t *n) {
  IN(~0);
  if (!c->exchange || !n) FAIL("it is part of model exchange, and returns a number");
  *n = 0;
  return fmi3OK;
}

API fmi3Status fmi3GetEventIndicators(fmi3Instance pointer, fmi3Float64 values[], size_t n) {
  IN(INITIALIZATION | INITIALIZED);
  if (!c->exchange || n) FAIL("this model has no event indicators");
  return fmi3OK;
}

API fmi3Status fmi3CompletedIntegratorStep(fmi3Instance pointer, fmi3Boolean no_return,
                                           fmi3Boolean *event, fmi3Boolean *terminate) {
  IN(CONTINUOUS);
  if (!event || !terminate) FAIL("a result is missing");
  *event = *terminate = false;
  return doubted(c, __func__);
}

/* Co-simulation. */

/* Steps up to a time; those that it cuts say nothing of how long the next one may be. */
static int advance(memory *m, double end) {
  settings s = {m->rtol, m->rtol, 0, end, 0, METHOD, 1, CORNERS, MOST_STEPS, m->corner,
                m->given, NULL, m->rtol};
  int status = SUCCESS, steps = 0, kept = 1;
  s.least = 4 * EPS * larger(fabs(m->t), fabs(end));
  s.fine = turning_rtol(&s, 0, 0);
  if (m->length == 0) m->length = larger(1e-3 * pow(s.fine, 0.2) * (end - m->t), s.least);
  while (m->t < end && status == SUCCESS) {
    double dt, next = limited(&s, m->t, m->t + m->length, kept);
    int cut = next < m->t + m->length;
    reach longer;
    if (steps++ >= MOST_STEPS) return MAX_STEPS;
    kept = attempt(m->t, next, &s, &m->m, &longer, &dt, &status);
    if (kept) {
      accept(&s, &m->m, &longer);
      m->t = next;
    }
    m->length = kept && cut ? larger(dt, m->length) : dt;
  }
  return status;
}

API fmi3Status fmi3DoStep(fmi3Instance pointer, fmi3Float64 time, fmi3Float64 length,
                          fmi3Boolean no_return, fmi3Boolean *event, fmi3Boolean *terminate,
                          fmi3Boolean *early, fmi3Float64 *last) {
  double good[4], end = time + length, size = 1;
  int status;
  IN(STEP);
  if (!event || !terminate || !early || !last) FAIL("a result is missing");
  *event = *terminate = *early = false;
  *last = c->now.t;
  if (!(isfinite(length) && length > 0)) FAIL("the length of a step is not positive");
  if (!(fabs(time - c->now.t) <= 1e-6 * length + NEAR_END * EPS * fabs(c->now.t)))
    FAIL("the step does not begin where the last one has ended");
  if (c->now.has_stop && end > c->now.stop + 1e-6 * length)
    FAIL("the step ends after the stop time");
  if (!(end > c->now.t)) FAIL("the step is shorter than what rounding leaves of the time");
  status = advance(&c->now, end);
  *last = c->now.t;
  if (status != SUCCESS) {
    *terminate = true;
    return say(c, fmi3Discard, __func__,
               status == MAX_STEPS ? "more than 100000 steps in one"
                                   : "the motion ceases to be finite, or steps become too short");
  }
  model_check(c->now.t, c->now.m.y, c->now.given, good);
  for (int i = 0; i < N; i++) size = larger(fabs(c->now.m.y[i]), size);
  if (!(good[2] <= 1e-2 * c->now.size + 10 * c->now.rtol * size))
    FAIL("the constraints are violated; ask for a smaller tolerance");
  return doubted(c, __func__);
}

/* States that are kept; those of an instance are its own. */

static saved *known(const instance *c, fmi3FMUState pointer) {
  saved *each = c->states;
  while (each && (fmi3FMUState)each != pointer) each = each->next;
  return each;
}

static saved *added(instance *c) {
  saved *new = malloc(sizeof *new);
  if (!new) return NULL;
  new->next = c->states;
  return c->states = new;
}

API fmi3Status fmi3GetFMUState(fmi3Instance pointer, fmi3FMUState *result) {
  saved *to;
  IN(~0);
  if (!result || (*result && !known(c, *result))) FAIL("the state is none of this instance");
  to = *result ? known(c, *result) : added(c);
  if (!to) FAIL("there is no memory left");
  to->kept = c->now;
  *result = to;
  return fmi3OK;
}

API fmi3Status fmi3SetFMUState(fmi3Instance pointer, fmi3FMUState from) {
  IN(~0);
  if (!known(c, from)) FAIL("the state is none of this instance");
  c->now = known(c, from)->kept;
  return fmi3OK;
}

API fmi3Status fmi3FreeFMUState(fmi3Instance pointer, fmi3FMUState *from) {
  saved **each, *found;
  IN(~0);
  if (!from) FAIL("the state is none of this instance");
  if (!*from) return fmi3OK;
  found = known(c, *from);
  if (!found) FAIL("the state is none of this instance");
  for (each = &c->states; *each != found;) each = &(*each)->next;
  *each = found->next;
  free(found);
  *from = NULL;
  return fmi3OK;
}

/* As bytes: the token, which tells models apart, and the memory. */
#define SERIALIZED (sizeof TOKEN + sizeof(memory))

API fmi3Status fmi3SerializedFMUStateSize(fmi3Instance pointer, fmi3FMUState from, size_t *size) {
  IN(~0);
  if (!known(c, from) || !size) FAIL("the state is none of this instance");
  *size = SERIALIZED;
  return fmi3OK;
}

API fmi3Status fmi3SerializeFMUState(fmi3Instance pointer, fmi3FMUState from, fmi3Byte bytes[],
                                     size_t size) {
  IN(~0);
  if (!known(c, from)) FAIL("the state is none of this instance");
  if (size != SERIALIZED || !bytes) FAIL("the size is not that of a state");
  memcpy(bytes, TOKEN, sizeof TOKEN);
  memcpy(bytes + sizeof TOKEN, &known(c, from)->kept, sizeof(memory));
  return fmi3OK;
}

API fmi3Status fmi3DeserializeFMUState(fmi3Instance pointer, const fmi3Byte bytes[], size_t size,
                                       fmi3FMUState *result) {
  saved *to;
  IN(~0);
  if (!result || (*result && !known(c, *result))) FAIL("the state is none of this instance");
  if (size != SERIALIZED || !bytes || memcmp(bytes, TOKEN, sizeof TOKEN))
    FAIL("the bytes are no state of this model");
  to = *result ? known(c, *result) : added(c);
  if (!to) FAIL("there is no memory left");
  memcpy(&to->kept, bytes + sizeof TOKEN, sizeof(memory));
  *result = to;
  return fmi3OK;
}
