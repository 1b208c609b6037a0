/* Runs within programs of XLA: of many lanes by threads, which take the next lane each. */
#include "xla/ffi/api/c_api.h"

enum { START, GIVEN, TIMES, NUMBERS, COUNTS, PRIMAL, D_START = PRIMAL, D_GIVEN, MOST };
enum { ROWS = 5, DERIVED = 3 };
#define MOST_AXES 32

/* The lanes of a call: those axes of a batch that no argument of a run has are its directions. */
typedef struct {
  XLA_FFI_Buffer *args[MOST], *rets[ROWS + DERIVED];
  int64_t sizes[MOST_AXES], lanes, groups, directions, next;
  int axes, shared[MOST_AXES], failed;
} call;

/* The numbers of an array in a lane; arrays are as wide as one or as the batch along each axis. */
static void *part(const call *c, const XLA_FFI_Buffer *b, const int64_t *at, int own) {
  int64_t index = 0, size = 8;
  for (int i = 0; i < c->axes; i++) index = index * b->dims[i] + (b->dims[i] > 1 ? at[i] : 0);
  for (int i = 0; i < own; i++) size *= b->dims[c->axes + i];
  return (char *)b->data + index * size;
}

/* Where a group of lanes is, and one of its directions. */
static void place(const call *c, int64_t group, int64_t direction, int64_t *at) {
  for (int i = c->axes - 1; i >= 0; i--) {
    int64_t *rest = c->shared[i] ? &direction : &group;
    at[i] = *rest % c->sizes[i];
    *rest /= c->sizes[i];
  }
}

static int run_group(const call *c, int64_t group) {
  int64_t at[MOST_AXES] = {0}, rows = c->args[TIMES]->dims[c->axes];
  const double *in[NUMBERS + 1];
  const directions *directed = NULL;
  int done = 1;
  place(c, group, 0, at);
  for (int i = 0; i <= NUMBERS; i++) in[i] = part(c, c->args[i], at, 1);
  const int64_t *counts = part(c, c->args[COUNTS], at, 1);
  double *q = part(c, c->rets[0], at, 2), *v = part(c, c->rets[1], at, 2);
  double *x = part(c, c->rets[2], at, 2), *violation = part(c, c->rets[3], at, 1);
  int64_t *told = part(c, c->rets[4], at, 1);
#ifdef ALONG
  int64_t many = c->directions;
  double *room = calloc(room_along(many), sizeof(double));
  void **where = malloc(sizeof(void *) * (2 + DERIVED) * (size_t)(many + 1));
  const directions along = {many, (const double *const *)where, (const double *const *)where + many,
                            (double *const *)where + 2 * many, (double *const *)where + 3 * many,
                            (double *const *)where + 4 * many, room};
  done = room && where;
  for (int64_t d = 0; done && d < many; d++) {
    place(c, group, d, at);
    for (int i = 0; i < 2; i++) where[i * many + d] = part(c, c->args[PRIMAL + i], at, 1);
    for (int i = 0; i < DERIVED; i++)
      where[(i + 2) * many + d] = part(c, c->rets[ROWS + i], at, 2);
  }
  directed = &along;
#endif
  if (done)
    model_run(in[START], in[GIVEN], in[TIMES], rows, in[NUMBERS], counts, q, v, x, violation, told,
              directed);
#ifdef ALONG
  free(room);
  free(where);
#endif
  return done;
}

static void *work(void *pointer) {
  call *c = pointer;
  for (;;) {
    int64_t group = __atomic_fetch_add(&c->next, 1, __ATOMIC_RELAXED);
    if (group >= c->groups) return NULL;
    if (!run_group(c, group)) __atomic_store_n(&c->failed, 1, __ATOMIC_RELAXED);
  }
}

static XLA_FFI_Error *error(const XLA_FFI_CallFrame *frame, const char *words) {
  XLA_FFI_Error_Create_Args args = {XLA_FFI_Error_Create_Args_STRUCT_SIZE, NULL, words,
                                    XLA_FFI_Error_Code_INTERNAL};
  return frame->api->XLA_FFI_Error_Create(&args);
}

XLA_FFI_Error *model_handler(XLA_FFI_CallFrame *frame) {
  // Its first part has another name in each version of XLA.
  XLA_FFI_Metadata_Extension *extension = (XLA_FFI_Metadata_Extension *)frame->extension_start;
  if (extension && extension->extension_base.type == XLA_FFI_Extension_Metadata) {
    XLA_FFI_Metadata *told = extension->metadata;
    told->api_version.major_version = XLA_FFI_API_MAJOR;
    told->api_version.minor_version = XLA_FFI_API_MINOR;
    return NULL;
  }
  call c = {0};
#ifdef ALONG
  const int gives = MOST, takes = ROWS + DERIVED, largest = ROWS;
#else
  const int gives = PRIMAL, takes = ROWS, largest = 0;
#endif
  if (frame->args.size != gives || frame->rets.size != takes)
    return error(frame, "another number of arguments or results");
  for (int i = 0; i < gives; i++) c.args[i] = frame->args.args[i];
  for (int i = 0; i < takes; i++) c.rets[i] = frame->rets.rets[i];
  c.axes = (int)c.rets[largest]->rank - 2;
  if (c.axes > MOST_AXES) return error(frame, "too many axes of a batch");
  c.groups = c.directions = 1;
  for (int i = 0; i < c.axes; i++) {
    c.sizes[i] = c.rets[largest]->dims[i];
    c.shared[i] = takes > ROWS;
    for (int k = 0; k < PRIMAL; k++) c.shared[i] &= c.args[k]->dims[i] == 1;
    *(c.shared[i] ? &c.directions : &c.groups) *= c.sizes[i];
  }
  /* The number of threads is the same for all lanes. */
  int64_t at[MOST_AXES] = {0}, threads = ((int64_t *)part(&c, c.args[COUNTS], at, 1))[4];
  pthread_t others[64];
  int started = 0;
  while (started < 64 && started + 1 < threads && started + 1 < c.groups)
    if (pthread_create(&others[started], NULL, work, &c)) break;
    else started++;
  work(&c);
  for (int i = 0; i < started; i++) pthread_join(others[i], NULL);
  return c.failed ? error(frame, "a compiled model found no memory") : NULL;
}
