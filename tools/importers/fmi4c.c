/* importer.h in fmi4c 1.2.  It does not read the dimensions of arrays: a caller must know the number of elements. */
#include "importer.h"

#include <fmi4c.h>
#include <stdarg.h>

static fmuHandle *fmu;
static fmi2InstanceHandle *two;
static fmi3InstanceHandle *three;

static void say(const char *message) { fprintf(stderr, "fmi4c: %s\n", message); }

static void say2(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...) {
  va_list values;
  (void)e, (void)name;
  fprintf(stderr, "FMU: %s (%d): ", category, (int)status);
  va_start(values, message);
  vfprintf(stderr, message, values);
  va_end(values);
  fputc('\n', stderr);
}

static void say3(fmi3InstanceEnvironment e, fmi3Status status, fmi3String category, fmi3String message) {
  (void)e;
  fprintf(stderr, "FMU: %s (%d): %s\n", category, (int)status, message);
}

void open_fmu(const char *path, const char *folder) {
  (void)folder;
  fmi4c_setMessageFunction(say);
  fmu = fmi4c_loadFmu(path, "x");
  need(fmu != NULL, "loading");
  if (fmi4c_getFmiVersion(fmu) == fmiVersion2) {
    two = fmi2_instantiate(fmu, fmi2CoSimulation, say2, calloc, free, NULL, NULL, fmi2False, fmi2False);
    need(two != NULL, "instantiating");
    need(!fmi2_setupExperiment(two, fmi2False, 0, 0, fmi2False, 0), "setting up");
    need(!fmi2_enterInitializationMode(two) && !fmi2_exitInitializationMode(two), "initializing");
    return;
  }
  three = fmi3_instantiateCoSimulation(fmu, 0, 0, 0, 0, NULL, 0, NULL, say3, NULL);
  need(three != NULL, "instantiating");
  need(!fmi3_enterInitializationMode(three, 0, 0, 0, 0, 0) && !fmi3_exitInitializationMode(three), "initializing");
}

Found find(const char *name, int elements) {
  if (two) {
    fmi2VariableHandle *v = fmi2_getVariableByName(fmu, name);
    need(v && elements == 1, name);
    return (Found){(uint32_t)fmi2_getVariableValueReference(v), fmi2_getVariableDataType(v) == fmi2DataTypeBoolean};
  }
  fmi3VariableHandle *v = fmi3_getVariableByName(fmu, name);
  need(v != NULL, name);
  return (Found){fmi3_getVariableValueReference(v), fmi3_getVariableDataType(v) == fmi3DataTypeBoolean};
}

int set_numbers(uint32_t reference, const double *values, size_t count) {
  return two ? (int)fmi2_setReal(two, &reference, 1, values) : (int)fmi3_setFloat64(three, &reference, 1, values, count);
}

int set_boolean(uint32_t reference, int value) {
  fmi2Boolean old = value;
  fmi3Boolean new = value != 0;
  return two ? (int)fmi2_setBoolean(two, &reference, 1, &old) : (int)fmi3_setBoolean(three, &reference, 1, &new, 1);
}

int get_numbers(uint32_t reference, double *values, size_t count) {
  return two ? (int)fmi2_getReal(two, &reference, 1, values) : (int)fmi3_getFloat64(three, &reference, 1, values, count);
}

int get_boolean(uint32_t reference, int *value) {
  fmi2Boolean old = 0;
  fmi3Boolean new = 0;
  int status = two ? (int)fmi2_getBoolean(two, &reference, 1, &old) : (int)fmi3_getBoolean(three, &reference, 1, &new, 1);
  *value = old || new;
  return status;
}

int do_step(double time, double step) {
  fmi3Boolean event, end, early;
  fmi3Float64 last;
  return two ? (int)fmi2_doStep(two, time, step, fmi2True) : (int)fmi3_doStep(three, time, step, 1, &event, &end, &early, &last);
}

void close_fmu(void) {
  if (two) {
    fmi2_terminate(two);
    fmi2_freeInstance(two);
  } else {
    fmi3_terminate(three);
    fmi3_freeInstance(three);
  }
  fmi4c_freeFmu(fmu);
}
