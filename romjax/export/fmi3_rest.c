/* What this model has none of: numbers of other kinds, clocks, partitions, configuration. */

#define NONE(kind)                                                                               \
  API fmi3Status fmi3Get##kind(fmi3Instance pointer, const fmi3ValueReference names[], size_t n, \
                               fmi3##kind values[], size_t count) {                              \
    IN(INITIALIZATION | INITIALIZED);                                                            \
    if (n || count) FAIL("this model has no variables of this type");                            \
    return fmi3OK;                                                                               \
  }                                                                                              \
  API fmi3Status fmi3Set##kind(fmi3Instance pointer, const fmi3ValueReference names[], size_t n, \
                               const fmi3##kind values[], size_t count) {                        \
    IN(~TERMINATED);                                                                             \
    if (n || count) FAIL("this model has no variables of this type");                            \
    return fmi3OK;                                                                               \
  }

NONE(Float32)
NONE(Int8)
NONE(UInt8)
NONE(Int16)
NONE(UInt16)
NONE(Int32)
NONE(UInt32)
NONE(Int64)
NONE(UInt64)
NONE(Boolean)
NONE(String)

/* A function that has nothing to do where it is asked for nothing, and else cannot do it. */
#define WITHOUT(name, count, ...)                                       \
  API fmi3Status name(fmi3Instance pointer, __VA_ARGS__) {              \
    IN(~0);                                                             \
    if (count) FAIL("this model has no variables of this type");        \
    return fmi3OK;                                                      \
  }
#define REFERENCES const fmi3ValueReference names[], size_t n

WITHOUT(fmi3GetBinary, n, REFERENCES, size_t sizes[], fmi3Binary values[], size_t k)
WITHOUT(fmi3SetBinary, n, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t k)
WITHOUT(fmi3GetClock, n, REFERENCES, fmi3Clock values[])
WITHOUT(fmi3SetClock, n, REFERENCES, const fmi3Clock values[])
WITHOUT(fmi3GetIntervalDecimal, n, REFERENCES, fmi3Float64 x[], fmi3IntervalQualifier y[])
WITHOUT(fmi3GetIntervalFraction, n, REFERENCES, fmi3UInt64 x[], fmi3UInt64 y[],
        fmi3IntervalQualifier z[])
WITHOUT(fmi3GetShiftDecimal, n, REFERENCES, fmi3Float64 x[])
WITHOUT(fmi3GetShiftFraction, n, REFERENCES, fmi3UInt64 x[], fmi3UInt64 y[])
WITHOUT(fmi3SetIntervalDecimal, n, REFERENCES, const fmi3Float64 x[])
WITHOUT(fmi3SetIntervalFraction, n, REFERENCES, const fmi3UInt64 x[], const fmi3UInt64 y[])
WITHOUT(fmi3SetShiftDecimal, n, REFERENCES, const fmi3Float64 x[])
WITHOUT(fmi3SetShiftFraction, n, REFERENCES, const fmi3UInt64 x[], const fmi3UInt64 y[])
WITHOUT(fmi3GetOutputDerivatives, n, REFERENCES, const fmi3Int32 orders[], fmi3Float64 x[],
        size_t k)
WITHOUT(fmi3GetNumberOfVariableDependencies, 1, fmi3ValueReference name, size_t *n)
WITHOUT(fmi3GetVariableDependencies, 1, fmi3ValueReference name, size_t x[],
        fmi3ValueReference y[], size_t z[], fmi3DependencyKind kinds[], size_t n)
WITHOUT(fmi3ActivateModelPartition, 1, fmi3ValueReference clock, fmi3Float64 time)

#define MISSING(name, what)                   \
  API fmi3Status name(fmi3Instance pointer) { \
    IN(~0);                                   \
    FAIL(what);                               \
  }

MISSING(fmi3EnterConfigurationMode, "this model has no structural parameters")
MISSING(fmi3ExitConfigurationMode, "this model has no structural parameters")
MISSING(fmi3EnterStepMode, "this model has no event mode in co-simulation")
MISSING(fmi3EvaluateDiscreteStates, "this model has no discrete states")

API fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String folder, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
  instance told = {0};
  told.logging = logging;
  told.environment = environment;
  told.logger = logger;
  say(&told, fmi3Error, __func__, "this model has no scheduled execution");
  return NULL;
}
