/* FMI 3.0 for Co-Simulation over instance.h.  A value reference is the number of a row, which is an array or a scalar; without
 * ARRAYS it is a place in the instance's array of variables. */
#include "instance.h"

/* In a program that links several FMUs, each function's name begins with that of its model.  FMI3_OVERRIDE_FUNCTION_PREFIX, for a
 * shared library, leaves the plain names. */
#if !defined(FMI3_FUNCTION_PREFIX) && !defined(FMI3_OVERRIDE_FUNCTION_PREFIX)
#define FMI3_FUNCTION_PREFIX MODEL_PREFIX
#endif
#include "fmi3Functions.h"

#define STATUS(done) ((done) ? fmi3OK : fmi3Error)
#define ALWAYS (INSTANTIATED | INITIALIZATION | STEPPING | TERMINATED | FAILED)

/* Define the instance `it` of the importer's handle, or return an error unless it is in one of `modes`. */
#define ENTER(modes, function)              \
  Instance *it = (Instance *)instance;      \
  if (it == NULL) return fmi3Error;         \
  if (!allowed(it, modes, function)) return fmi3Error

/* Refuse a call of a function that this FMU does not support. */
#define NONE_SUCH(function, reason)         \
  do {                                      \
    Instance *it = (Instance *)instance;    \
    if (it == NULL) return fmi3Error;       \
    say(it, ERROR, "%s: %s", function, reason); \
    return fmi3Error;                       \
  } while (0)

static void say3(Instance *it, int level, const char *message) {
  static const fmi3Status STATUSES[] = {fmi3OK, fmi3Error, fmi3Warning};
  static const char *const CATEGORIES[] = {"logEvents", "logStatusError", "logStatusWarning"};
  fmi3LogMessageCallback logger;
  memcpy(&logger, &it->logger, sizeof logger);
  if (logger == NULL) return;
  logger(it->environment, STATUSES[level], CATEGORIES[level], message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories, const fmi3String categories[]) {
  int events = nCategories == 0;
  ENTER(ALWAYS, "fmi3SetDebugLogging");
  if (nCategories && categories == NULL) NONE_SUCH("fmi3SetDebugLogging", "categories is NULL");
  for (size_t i = 0; i < nCategories; ++i) {
    const char *name = categories[i] ? categories[i] : "NULL";
    if (!strcmp(name, "logEvents")) events = 1;
    else if (strcmp(name, "logStatusError") && strcmp(name, "logStatusWarning")) {
      say(it, ERROR, "fmi3SetDebugLogging: no category %s: allowed is logEvents, logStatusWarning or logStatusError", name);
      return fmi3Error;
    }
  }
  if (events) it->events_logged = loggingOn;
  return fmi3OK;
}

/* Log why there is no instance. */
static fmi3Instance refused(fmi3LogMessageCallback logMessage, fmi3InstanceEnvironment environment, const char *reason) {
  if (logMessage) logMessage(environment, fmi3Error, "logStatusError", reason);
  return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                          fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage) {
  (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible, (void)loggingOn;
  return refused(logMessage, instanceEnvironment, "fmi3InstantiateModelExchange: this FMU is for Co-Simulation");
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                               fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
                                               fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption) {
  (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible, (void)loggingOn, (void)clockUpdate;
  (void)lockPreemption, (void)unlockPreemption;
  return refused(logMessage, instanceEnvironment, "fmi3InstantiateScheduledExecution: this FMU is for Co-Simulation");
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                         fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
                                         fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate) {
  Instance *it;
  const char *wrong = NULL;
  (void)resourcePath, (void)visible, (void)earlyReturnAllowed, (void)requiredIntermediateVariables, (void)intermediateUpdate;
  if (instanceName == NULL || instanceName[0] == 0) wrong = "fmi3InstantiateCoSimulation: instanceName is missing or empty";
  else if (instantiationToken == NULL || strcmp(instantiationToken, TOKEN))
    wrong = "fmi3InstantiateCoSimulation: instantiationToken is not that of modelDescription.xml: " TOKEN;
  else if (eventModeUsed) wrong = "fmi3InstantiateCoSimulation: eventModeUsed: there is no event mode (hasEventMode is false)";
  else if (nRequiredIntermediateVariables)
    wrong = "fmi3InstantiateCoSimulation: there is no intermediate update (providesIntermediateUpdate is false)";
  if (wrong) return refused(logMessage, instanceEnvironment, wrong);
  it = new_instance(instanceName);
  if (it == NULL) return NULL;
  it->environment = instanceEnvironment;
  memcpy(&it->logger, &logMessage, sizeof it->logger);
  it->say = say3;
  it->events_logged = loggingOn;
  say(it, EVENT, "instantiated");
  return it;
}

void fmi3FreeInstance(fmi3Instance instance) { free_instance((Instance *)instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
  (void)toleranceDefined, (void)tolerance; /* there is no solver with a tolerance */
  ENTER(INSTANTIATED, "fmi3EnterInitializationMode");
  return STATUS(set_times(it, "fmi3EnterInitializationMode", startTime, stopTimeDefined, stopTime) && enter_initialization(it));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
  ENTER(INITIALIZATION, "fmi3ExitInitializationMode");
  return STATUS(exit_initialization(it));
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
  ENTER(STEPPING | FAILED, "fmi3Terminate");
  it->now.mode = TERMINATED;
  say(it, EVENT, "terminated");
  return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
  ENTER(ALWAYS, "fmi3Reset");
  to_start(it);
  say(it, EVENT, "reset");
  return fmi3OK;
}

/* Place and number of elements of a variable. */
#if ARRAYS
#define N_REFERENCE N_ROW
#define PLACE(reference) (ROWS[reference].place)
#define SIZE(reference) (ROWS[reference].size)
#else
#define N_REFERENCE N_VALUE
#define PLACE(reference) ((size_t)(reference))
#define SIZE(reference) ((size_t)((void)(reference), 1))
#endif

/* Whether the value references are those of variables of one type, whose sizes add up to nValues. */
static int check_references(Instance *it, const char *function, const fmi3ValueReference vr[], size_t n, const void *values,
                            size_t nValues, int flags) {
  size_t size = 0;
  if ((n && vr == NULL) || (nValues && values == NULL)) REFUSE("%s: valueReferences or values is NULL", function);
  for (size_t i = 0; i < n; ++i) {
    if (vr[i] >= N_REFERENCE || KIND[PLACE(vr[i])] == NONE)
      REFUSE("%s: no variable has the value reference %lu", function, (unsigned long)vr[i]);
    if (is_flag(PLACE(vr[i])) != flags)
      REFUSE("%s: %s is a %s", function, row_of(PLACE(vr[i]))->name, flags ? "Float64" : "Boolean: call the function of this type");
    size += SIZE(vr[i]);
  }
  if (size != nValues)
    REFUSE("%s: nValues = %lu: allowed is %lu, the number of elements of the variables", function, (unsigned long)nValues,
           (unsigned long)size);
  return 1;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Float64 values[], size_t nValues) {
  ENTER(INITIALIZATION | STEPPING | TERMINATED | FAILED, "fmi3GetFloat64");
  if (!check_references(it, "fmi3GetFloat64", valueReferences, nValueReferences, values, nValues, 0) || !refresh(it))
    return fmi3Error;
  for (size_t i = 0; i < nValueReferences; values += SIZE(valueReferences[i]), ++i)
    memcpy(values, it->now.v + PLACE(valueReferences[i]), SIZE(valueReferences[i]) * sizeof *values);
  return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Float64 values[], size_t nValues) {
  const double *value = values;
  ENTER(INSTANTIATED | INITIALIZATION | STEPPING, "fmi3SetFloat64");
  if (!check_references(it, "fmi3SetFloat64", valueReferences, nValueReferences, values, nValues, 0)) return fmi3Error;
  for (size_t i = 0; i < nValueReferences; value += SIZE(valueReferences[i]), ++i) {
    if (!settable(it, PLACE(valueReferences[i]), "fmi3SetFloat64")) return fmi3Error;
    if (!check_values(it, "fmi3SetFloat64", PLACE(valueReferences[i]), SIZE(valueReferences[i]), value)) return fmi3Error;
  }
  for (size_t i = 0; i < nValueReferences; values += SIZE(valueReferences[i]), ++i)
    put_values(it, PLACE(valueReferences[i]), SIZE(valueReferences[i]), values);
  return fmi3OK;
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Boolean values[], size_t nValues) {
  ENTER(INITIALIZATION | STEPPING | TERMINATED | FAILED, "fmi3GetBoolean");
  if (!check_references(it, "fmi3GetBoolean", valueReferences, nValueReferences, values, nValues, 1) || !refresh(it))
    return fmi3Error;
  for (size_t i = 0; i < nValueReferences; ++i) values[i] = it->now.v[PLACE(valueReferences[i])] != 0;
  return fmi3OK;
}

fmi3Status fmi3SetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Boolean values[], size_t nValues) {
  ENTER(INSTANTIATED | INITIALIZATION | STEPPING, "fmi3SetBoolean");
  if (!check_references(it, "fmi3SetBoolean", valueReferences, nValueReferences, values, nValues, 1)) return fmi3Error;
  for (size_t i = 0; i < nValueReferences; ++i)
    if (!settable(it, PLACE(valueReferences[i]), "fmi3SetBoolean")) return fmi3Error;
  for (size_t i = 0; i < nValueReferences; ++i) {
    double flag = values[i] != 0;
    put_values(it, PLACE(valueReferences[i]), 1, &flag);
  }
  return fmi3OK;
}

/* Every variable is a Float64 or a Boolean: there are no variables of other types to get or set. */
#define NO_VARIABLES(name, type)                                                                                              \
  fmi3Status fmi3Get##name(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,        \
                           type values[], size_t nValues) {                                                                   \
    ENTER(INITIALIZATION | STEPPING | TERMINATED | FAILED, "fmi3Get" #name);                                                  \
    (void)valueReferences, (void)values;                                                                                      \
    if (nValueReferences || nValues) NONE_SUCH("fmi3Get" #name, "there are no variables of this type");                       \
    return fmi3OK;                                                                                                            \
  }                                                                                                                           \
  fmi3Status fmi3Set##name(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,        \
                           const type values[], size_t nValues) {                                                             \
    ENTER(INSTANTIATED | INITIALIZATION | STEPPING, "fmi3Set" #name);                                                         \
    (void)valueReferences, (void)values;                                                                                      \
    if (nValueReferences || nValues) NONE_SUCH("fmi3Set" #name, "there are no variables of this type");                       \
    return fmi3OK;                                                                                                            \
  }
NO_VARIABLES(Float32, fmi3Float32)
NO_VARIABLES(Int8, fmi3Int8)
NO_VARIABLES(UInt8, fmi3UInt8)
NO_VARIABLES(Int16, fmi3Int16)
NO_VARIABLES(UInt16, fmi3UInt16)
NO_VARIABLES(Int32, fmi3Int32)
NO_VARIABLES(UInt32, fmi3UInt32)
NO_VARIABLES(Int64, fmi3Int64)
NO_VARIABLES(UInt64, fmi3UInt64)
NO_VARIABLES(String, fmi3String)

/* A function whose arguments after the first are not used. */
#define WITHOUT(function, reason, ...)                                     \
  fmi3Status function(fmi3Instance instance, __VA_ARGS__) { NONE_SUCH(#function, reason); }
#define NO_TYPE "there are no variables of this type"
#define NO_CLOCKS "there are no clocks"
#define NO_EVENTS "there is no event mode (hasEventMode is false)"
#define NO_DERIVATIVES "not provided (modelDescription.xml says so)"
#define EXCHANGE "for Model Exchange only: this FMU is for Co-Simulation"

WITHOUT(fmi3GetBinary, NO_TYPE, const fmi3ValueReference rows[], size_t n, size_t sizes[], fmi3Binary values[], size_t nValues)
WITHOUT(fmi3SetBinary, NO_TYPE, const fmi3ValueReference rows[], size_t n, const size_t sizes[], const fmi3Binary values[],
        size_t nValues)
WITHOUT(fmi3GetClock, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, fmi3Clock values[])
WITHOUT(fmi3SetClock, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, const fmi3Clock values[])
WITHOUT(fmi3GetIntervalDecimal, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, fmi3Float64 intervals[],
        fmi3IntervalQualifier qualifiers[])
WITHOUT(fmi3GetIntervalFraction, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, fmi3UInt64 counters[],
        fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
WITHOUT(fmi3GetShiftDecimal, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, fmi3Float64 shifts[])
WITHOUT(fmi3GetShiftFraction, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, fmi3UInt64 counters[],
        fmi3UInt64 resolutions[])
WITHOUT(fmi3SetIntervalDecimal, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, const fmi3Float64 intervals[])
WITHOUT(fmi3SetIntervalFraction, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, const fmi3UInt64 counters[],
        const fmi3UInt64 resolutions[])
WITHOUT(fmi3SetShiftDecimal, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, const fmi3Float64 shifts[])
WITHOUT(fmi3SetShiftFraction, NO_CLOCKS, const fmi3ValueReference rows[], size_t n, const fmi3UInt64 counters[],
        const fmi3UInt64 resolutions[])
WITHOUT(fmi3ActivateModelPartition, NO_CLOCKS, fmi3ValueReference clockReference, fmi3Float64 activationTime)

WITHOUT(fmi3UpdateDiscreteStates, NO_EVENTS, fmi3Boolean *needUpdate, fmi3Boolean *terminate, fmi3Boolean *nominals,
        fmi3Boolean *values, fmi3Boolean *nextDefined, fmi3Float64 *next)
fmi3Status fmi3EnterEventMode(fmi3Instance instance) { NONE_SUCH("fmi3EnterEventMode", NO_EVENTS); }
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) { NONE_SUCH("fmi3EvaluateDiscreteStates", NO_EVENTS); }
fmi3Status fmi3EnterStepMode(fmi3Instance instance) { NONE_SUCH("fmi3EnterStepMode", NO_EVENTS); }
fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) {
  NONE_SUCH("fmi3EnterConfigurationMode", "there are no structural parameters");
}
fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) {
  NONE_SUCH("fmi3ExitConfigurationMode", "there are no structural parameters");
}

WITHOUT(fmi3GetNumberOfVariableDependencies, NO_DERIVATIVES, fmi3ValueReference row, size_t *nDependencies)
WITHOUT(fmi3GetVariableDependencies, NO_DERIVATIVES, fmi3ValueReference dependent, size_t elementsOfDependent[],
        fmi3ValueReference independents[], size_t elementsOfIndependents[], fmi3DependencyKind kinds[], size_t nDependencies)
WITHOUT(fmi3GetDirectionalDerivative, NO_DERIVATIVES, const fmi3ValueReference unknowns[], size_t nUnknowns,
        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[],
        size_t nSensitivity)
WITHOUT(fmi3GetAdjointDerivative, NO_DERIVATIVES, const fmi3ValueReference unknowns[], size_t nUnknowns,
        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[],
        size_t nSensitivity)
WITHOUT(fmi3GetOutputDerivatives, NO_DERIVATIVES, const fmi3ValueReference rows[], size_t n, const fmi3Int32 orders[],
        fmi3Float64 values[], size_t nValues)

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) { NONE_SUCH("fmi3EnterContinuousTimeMode", EXCHANGE); }
WITHOUT(fmi3CompletedIntegratorStep, EXCHANGE, fmi3Boolean noSet, fmi3Boolean *enterEventMode, fmi3Boolean *terminate)
WITHOUT(fmi3SetTime, EXCHANGE, fmi3Float64 time)
WITHOUT(fmi3SetContinuousStates, EXCHANGE, const fmi3Float64 states[], size_t n)
WITHOUT(fmi3GetContinuousStateDerivatives, EXCHANGE, fmi3Float64 derivatives[], size_t n)
WITHOUT(fmi3GetEventIndicators, EXCHANGE, fmi3Float64 indicators[], size_t n)
WITHOUT(fmi3GetContinuousStates, EXCHANGE, fmi3Float64 states[], size_t n)
WITHOUT(fmi3GetNominalsOfContinuousStates, EXCHANGE, fmi3Float64 nominals[], size_t n)
WITHOUT(fmi3GetNumberOfEventIndicators, EXCHANGE, size_t *n)
WITHOUT(fmi3GetNumberOfContinuousStates, EXCHANGE, size_t *n)

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
  ENTER(ALWAYS, "fmi3GetFMUState");
  return STATUS(save(it, "fmi3GetFMUState", FMUState));
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState) {
  ENTER(ALWAYS, "fmi3SetFMUState");
  return STATUS(restore(it, "fmi3SetFMUState", FMUState));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
  ENTER(ALWAYS, "fmi3FreeFMUState");
  return STATUS(free_saved(it, "fmi3FreeFMUState", FMUState));
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size) {
  ENTER(ALWAYS, "fmi3SerializedFMUStateSize");
  if (size == NULL || !is_ours((const Saved *)FMUState))
    NONE_SUCH("fmi3SerializedFMUStateSize", size ? "not a state of this FMU" : "size is NULL");
  *size = SERIAL_SIZE;
  return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size) {
  ENTER(ALWAYS, "fmi3SerializeFMUState");
  return STATUS(serialize(it, "fmi3SerializeFMUState", FMUState, serializedState, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size, fmi3FMUState *FMUState) {
  ENTER(ALWAYS, "fmi3DeserializeFMUState");
  return STATUS(deserialize(it, "fmi3DeserializeFMUState", serializedState, size, FMUState));
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime) {
  (void)noSetFMUStatePriorToCurrentPoint;
  ENTER(STEPPING, "fmi3DoStep");
  if (eventHandlingNeeded == NULL || terminateSimulation == NULL || earlyReturn == NULL || lastSuccessfulTime == NULL)
    NONE_SUCH("fmi3DoStep", "the address of a result is NULL");
  *eventHandlingNeeded = *terminateSimulation = *earlyReturn = fmi3False;
  *lastSuccessfulTime = it->now.v[0];
  if (!do_step(it, "fmi3DoStep", currentCommunicationPoint, communicationStepSize)) return fmi3Error;
  *lastSuccessfulTime = it->now.v[0];
  return fmi3OK;
}
