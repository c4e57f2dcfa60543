/* FMI 2.0 for Co-Simulation over instance.h.  A value reference is a place in the instance's array of variables. */
#include "instance.h"

/* In a program that links several FMUs, each function's name begins with that of its model.  FMI2_OVERRIDE_FUNCTION_PREFIX, for a
 * shared library, leaves the plain names. */
#if !defined(FMI2_FUNCTION_PREFIX) && !defined(FMI2_OVERRIDE_FUNCTION_PREFIX)
#define FMI2_FUNCTION_PREFIX MODEL_PREFIX
#endif
#include "fmi2Functions.h"

#define STATUS(done) ((done) ? fmi2OK : fmi2Error)
#define ALWAYS (INSTANTIATED | INITIALIZATION | STEPPING | TERMINATED | FAILED)

/* Define the instance `it` of a component, or return an error unless it is in one of `modes`. */
#define ENTER(modes, function)              \
  Instance *it = (Instance *)c;             \
  if (it == NULL) return fmi2Error;         \
  if (!allowed(it, modes, function)) return fmi2Error

/* Refuse a call of a function that this FMU does not support. */
#define NONE_SUCH(function, reason)         \
  do {                                      \
    Instance *it = (Instance *)c;           \
    if (it == NULL) return fmi2Error;       \
    say(it, ERROR, "%s: %s", function, reason); \
    return fmi2Error;                       \
  } while (0)

static void say2(Instance *it, int level, const char *message) {
  static const fmi2Status STATUSES[] = {fmi2OK, fmi2Error, fmi2Warning};
  static const char *const CATEGORIES[] = {"logEvents", "logStatusError", "logStatusWarning"};
  fmi2CallbackLogger logger;
  memcpy(&logger, &it->logger, sizeof logger);
  if (logger == NULL) return;
  logger(it->environment, it->name, STATUSES[level], CATEGORIES[level], "%s", message);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String categories[]) {
  int events = nCategories == 0;
  ENTER(ALWAYS, "fmi2SetDebugLogging");
  if (nCategories && categories == NULL) NONE_SUCH("fmi2SetDebugLogging", "categories is NULL");
  for (size_t i = 0; i < nCategories; ++i) {
    const char *name = categories[i] ? categories[i] : "NULL";
    if (!strcmp(name, "logEvents") || !strcmp(name, "logAll")) events = 1;
    else if (strcmp(name, "logStatusError") && strcmp(name, "logStatusWarning")) {
      say(it, ERROR, "fmi2SetDebugLogging: no category %s: allowed is logAll, logEvents, logStatusWarning or logStatusError", name);
      return fmi2Error;
    }
  }
  if (events) it->events_logged = loggingOn != 0;
  return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID, fmi2String fmuResourceLocation,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean loggingOn) {
  Instance *it;
  const char *wrong = NULL;
  (void)fmuResourceLocation, (void)visible;
  if (functions == NULL) return NULL;
  if (instanceName == NULL || instanceName[0] == 0) wrong = "instanceName is missing or empty";
  else if (fmuType != fmi2CoSimulation) wrong = "fmuType: allowed is fmi2CoSimulation";
  else if (fmuGUID == NULL || strcmp(fmuGUID, TOKEN)) wrong = "fmuGUID is not that of modelDescription.xml: " TOKEN;
  if (wrong) {
    if (functions->logger)
      functions->logger(functions->componentEnvironment, instanceName ? instanceName : "?", fmi2Error, "logStatusError",
                        "fmi2Instantiate: %s", wrong);
    return NULL;
  }
  it = new_instance(instanceName);
  if (it == NULL) return NULL;
  it->environment = functions->componentEnvironment;
  memcpy(&it->logger, &functions->logger, sizeof it->logger);
  it->say = say2;
  it->events_logged = loggingOn != 0;
  say(it, EVENT, "instantiated");
  return it;
}

void fmi2FreeInstance(fmi2Component c) { free_instance((Instance *)c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
  (void)toleranceDefined, (void)tolerance; /* there is no solver with a tolerance */
  ENTER(INSTANTIATED, "fmi2SetupExperiment");
  return STATUS(set_times(it, "fmi2SetupExperiment", startTime, stopTimeDefined, stopTime));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  ENTER(INSTANTIATED, "fmi2EnterInitializationMode");
  return STATUS(enter_initialization(it));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  ENTER(INITIALIZATION, "fmi2ExitInitializationMode");
  return STATUS(exit_initialization(it));
}

fmi2Status fmi2Terminate(fmi2Component c) {
  ENTER(STEPPING | FAILED, "fmi2Terminate");
  it->now.mode = TERMINATED;
  say(it, EVENT, "terminated");
  return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
  ENTER(ALWAYS, "fmi2Reset");
  to_start(it);
  say(it, EVENT, "reset");
  return fmi2OK;
}

/* Whether the value references are those of variables of one type. */
static int check_references(Instance *it, const char *function, const fmi2ValueReference vr[], size_t nvr, const void *value,
                            int flags) {
  if (nvr && (vr == NULL || value == NULL)) REFUSE("%s: vr or value is NULL", function);
  for (size_t i = 0; i < nvr; ++i) {
    if (vr[i] >= N_VALUE || KIND[vr[i]] == NONE) REFUSE("%s: no variable has the value reference %u", function, vr[i]);
    if (is_flag(vr[i]) != flags)
      REFUSE("%s: %s is a %s", function, row_of(vr[i])->name, flags ? "Real" : "Boolean: call the function of this type");
  }
  return 1;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
  ENTER(INITIALIZATION | STEPPING | TERMINATED | FAILED, "fmi2GetReal");
  if (!check_references(it, "fmi2GetReal", vr, nvr, value, 0) || !refresh(it)) return fmi2Error;
  for (size_t i = 0; i < nvr; ++i) value[i] = it->now.v[vr[i]];
  return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
  ENTER(INSTANTIATED | INITIALIZATION | STEPPING, "fmi2SetReal");
  if (!check_references(it, "fmi2SetReal", vr, nvr, value, 0)) return fmi2Error;
  for (size_t i = 0; i < nvr; ++i)
    if (!settable(it, vr[i], "fmi2SetReal") || !check_values(it, "fmi2SetReal", vr[i], 1, &value[i])) return fmi2Error;
  for (size_t i = 0; i < nvr; ++i) put_values(it, vr[i], 1, &value[i]);
  return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
  ENTER(INITIALIZATION | STEPPING | TERMINATED | FAILED, "fmi2GetBoolean");
  if (!check_references(it, "fmi2GetBoolean", vr, nvr, value, 1) || !refresh(it)) return fmi2Error;
  for (size_t i = 0; i < nvr; ++i) value[i] = it->now.v[vr[i]] != 0;
  return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[]) {
  ENTER(INSTANTIATED | INITIALIZATION | STEPPING, "fmi2SetBoolean");
  if (!check_references(it, "fmi2SetBoolean", vr, nvr, value, 1)) return fmi2Error;
  for (size_t i = 0; i < nvr; ++i)
    if (!settable(it, vr[i], "fmi2SetBoolean")) return fmi2Error;
  for (size_t i = 0; i < nvr; ++i) {
    double flag = value[i] != 0;
    put_values(it, vr[i], 1, &flag);
  }
  return fmi2OK;
}

/* Every variable is a Real or a Boolean: there are no variables of other types to get or set. */
#define NO_VARIABLES(type)                                                                                                    \
  fmi2Status fmi2Get##type(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2##type value[]) {                   \
    ENTER(INITIALIZATION | STEPPING | TERMINATED | FAILED, "fmi2Get" #type);                                                  \
    (void)vr, (void)value;                                                                                                    \
    if (nvr) NONE_SUCH("fmi2Get" #type, "there are no variables of this type");                                               \
    return fmi2OK;                                                                                                            \
  }                                                                                                                           \
  fmi2Status fmi2Set##type(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2##type value[]) {             \
    ENTER(INSTANTIATED | INITIALIZATION | STEPPING, "fmi2Set" #type);                                                         \
    (void)vr, (void)value;                                                                                                    \
    if (nvr) NONE_SUCH("fmi2Set" #type, "there are no variables of this type");                                               \
    return fmi2OK;                                                                                                            \
  }
NO_VARIABLES(Integer)
NO_VARIABLES(String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
  ENTER(ALWAYS, "fmi2GetFMUstate");
  return STATUS(save(it, "fmi2GetFMUstate", FMUstate));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
  ENTER(ALWAYS, "fmi2SetFMUstate");
  return STATUS(restore(it, "fmi2SetFMUstate", FMUstate));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
  ENTER(ALWAYS, "fmi2FreeFMUstate");
  return STATUS(free_saved(it, "fmi2FreeFMUstate", FMUstate));
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
  ENTER(ALWAYS, "fmi2SerializedFMUstateSize");
  if (size == NULL || !is_ours((const Saved *)FMUstate))
    NONE_SUCH("fmi2SerializedFMUstateSize", size ? "not a state of this FMU" : "size is NULL");
  *size = SERIAL_SIZE;
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte bytes[], size_t size) {
  ENTER(ALWAYS, "fmi2SerializeFMUstate");
  return STATUS(serialize(it, "fmi2SerializeFMUstate", FMUstate, (unsigned char *)bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *FMUstate) {
  ENTER(ALWAYS, "fmi2DeSerializeFMUstate");
  return STATUS(deserialize(it, "fmi2DeSerializeFMUstate", (const unsigned char *)bytes, size, FMUstate));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
  (void)noSetFMUStatePriorToCurrentPoint;
  ENTER(STEPPING, "fmi2DoStep");
  return STATUS(do_step(it, "fmi2DoStep", currentCommunicationPoint, communicationStepSize));
}

fmi2Status fmi2CancelStep(fmi2Component c) { NONE_SUCH("fmi2CancelStep", "no step is under way: steps are synchronous"); }

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
  (void)s, (void)value;
  NONE_SUCH("fmi2GetStatus", "no step is pending: steps are synchronous");
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
  ENTER(STEPPING | TERMINATED | FAILED, "fmi2GetRealStatus");
  if (value == NULL || s != fmi2LastSuccessfulTime)
    NONE_SUCH("fmi2GetRealStatus", value ? "allowed is fmi2LastSuccessfulTime" : "value is NULL");
  *value = it->now.v[0];
  return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
  (void)s, (void)value;
  NONE_SUCH("fmi2GetIntegerStatus", "FMI 2.0 defines no such status");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
  ENTER(STEPPING | TERMINATED | FAILED, "fmi2GetBooleanStatus");
  if (value == NULL || s != fmi2Terminated)
    NONE_SUCH("fmi2GetBooleanStatus", value ? "allowed is fmi2Terminated" : "value is NULL");
  *value = fmi2False; /* the FMU never asks to end the simulation */
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
  (void)s, (void)value;
  NONE_SUCH("fmi2GetStringStatus", "no step is pending: steps are synchronous");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                       const fmi2Real value[]) {
  (void)vr, (void)nvr, (void)order, (void)value;
  NONE_SUCH("fmi2SetRealInputDerivatives", "inputs are held over a step (canInterpolateInputs is false)");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                        fmi2Real value[]) {
  (void)vr, (void)nvr, (void)order, (void)value;
  NONE_SUCH("fmi2GetRealOutputDerivatives", "outputs have no derivatives (maxOutputDerivativeOrder is 0)");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[]) {
  (void)vUnknown_ref, (void)nUnknown, (void)vKnown_ref, (void)nKnown, (void)dvKnown, (void)dvUnknown;
  NONE_SUCH("fmi2GetDirectionalDerivative", "not provided (providesDirectionalDerivative is false)");
}

/* --- Model Exchange is not supported; the functions exist for importers that resolve every function of the standard -------- */

#define MODEL_EXCHANGE(function) NONE_SUCH(function, "for Model Exchange only: this FMU is for Co-Simulation")

fmi2Status fmi2EnterEventMode(fmi2Component c) { MODEL_EXCHANGE("fmi2EnterEventMode"); }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
  (void)info;
  MODEL_EXCHANGE("fmi2NewDiscreteStates");
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { MODEL_EXCHANGE("fmi2EnterContinuousTimeMode"); }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSet, fmi2Boolean *enter, fmi2Boolean *terminate) {
  (void)noSet, (void)enter, (void)terminate;
  MODEL_EXCHANGE("fmi2CompletedIntegratorStep");
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
  (void)time;
  MODEL_EXCHANGE("fmi2SetTime");
}
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx) {
  (void)x, (void)nx;
  MODEL_EXCHANGE("fmi2SetContinuousStates");
}
#define CONTINUOUS(function)                                              \
  fmi2Status function(fmi2Component c, fmi2Real value[], size_t n) {      \
    (void)value, (void)n;                                                 \
    MODEL_EXCHANGE("function of continuous states");                      \
  }
CONTINUOUS(fmi2GetDerivatives)
CONTINUOUS(fmi2GetEventIndicators)
CONTINUOUS(fmi2GetContinuousStates)
CONTINUOUS(fmi2GetNominalsOfContinuousStates)
