/* importer.h in FMI Library 3. */
#include "importer.h"

#include <fmilib.h>

static jm_callbacks callbacks;
static fmi_import_context_t *context;
static fmi2_import_t *two;
static fmi3_import_t *three;

static void say(jm_callbacks *c, jm_string module, jm_log_level_enu_t level, jm_string message) {
  (void)c;
  fprintf(stderr, "FMI Library: %s (%d): %s\n", module, (int)level, message);
}

static void say3(fmi3_instance_environment_t e, fmi3_status_t status, fmi3_string_t category, fmi3_string_t message) {
  (void)e;
  fprintf(stderr, "FMU: %s (%d): %s\n", category, (int)status, message);
}

void open_fmu(const char *path, const char *folder) {
  callbacks = (jm_callbacks){malloc, calloc, realloc, free, say, jm_log_level_warning, NULL, ""};
  context = fmi_import_allocate_context(&callbacks);
  fmi_version_enu_t version = fmi_import_get_fmi_version(context, path, folder);
  if (version == fmi_version_2_0_enu) {
    static fmi2_callback_functions_t functions;
    functions = (fmi2_callback_functions_t){fmi2_log_forwarding, calloc, free, NULL, NULL};
    two = fmi2_import_parse_xml(context, folder, NULL);
    need(two != NULL, "reading the description");
    functions.componentEnvironment = two;
    need(fmi2_import_create_dllfmu(two, fmi2_fmu_kind_cs, &functions) != jm_status_error, "loading");
    need(fmi2_import_instantiate(two, "x", fmi2_cosimulation, NULL, fmi2_false) != jm_status_error, "instantiating");
    need(!fmi2_import_setup_experiment(two, fmi2_false, 0, 0, fmi2_false, 0), "setting up");
    need(!fmi2_import_enter_initialization_mode(two) && !fmi2_import_exit_initialization_mode(two), "initializing");
    return;
  }
  need(version == fmi_version_3_0_enu, "recognizing the version");
  three = fmi3_import_parse_xml(context, folder, NULL);
  need(three != NULL, "reading the description");
  need(fmi3_import_create_dllfmu(three, fmi3_fmu_kind_cs, NULL, say3) != jm_status_error, "loading");
  need(fmi3_import_instantiate_co_simulation(three, "x", NULL, 0, 0, 0, 0, NULL, 0, NULL) != jm_status_error, "instantiating");
  need(!fmi3_import_enter_initialization_mode(three, 0, 0, 0, 0, 0) && !fmi3_import_exit_initialization_mode(three), "initializing");
}

Found find(const char *name, int elements) {
  if (two) {
    fmi2_import_variable_t *v = fmi2_import_get_variable_by_name(two, name);
    need(v && elements == 1, name);
    return (Found){fmi2_import_get_variable_vr(v), fmi2_import_get_variable_base_type(v) == fmi2_base_type_bool};
  }
  fmi3_import_variable_t *v = fmi3_import_get_variable_by_name(three, name);
  need(v != NULL, name);
  fmi3_import_dimension_list_t *list = fmi3_import_get_variable_dimension_list(v);
  int declared = 1;
  for (size_t i = 0; i < fmi3_import_get_dimension_list_size(list); i++)
    declared *= (int)fmi3_import_get_dimension_start(fmi3_import_get_dimension(list, i));
  need(declared == elements, name);
  return (Found){fmi3_import_get_variable_vr(v), fmi3_import_get_variable_base_type(v) == fmi3_base_type_bool};
}

int set_numbers(uint32_t reference, const double *values, size_t count) {
  return two ? (int)fmi2_import_set_real(two, &reference, 1, values) : (int)fmi3_import_set_float64(three, &reference, 1, values, count);
}

int set_boolean(uint32_t reference, int value) {
  fmi2_boolean_t old = value ? fmi2_true : fmi2_false;
  fmi3_boolean_t new = value != 0;
  return two ? (int)fmi2_import_set_boolean(two, &reference, 1, &old) : (int)fmi3_import_set_boolean(three, &reference, 1, &new, 1);
}

int get_numbers(uint32_t reference, double *values, size_t count) {
  return two ? (int)fmi2_import_get_real(two, &reference, 1, values) : (int)fmi3_import_get_float64(three, &reference, 1, values, count);
}

int get_boolean(uint32_t reference, int *value) {
  fmi2_boolean_t old = 0;
  fmi3_boolean_t new = 0;
  int status = two ? (int)fmi2_import_get_boolean(two, &reference, 1, &old) : (int)fmi3_import_get_boolean(three, &reference, 1, &new, 1);
  *value = old || new;
  return status;
}

int do_step(double time, double step) {
  fmi3_boolean_t event, end, early;
  fmi3_float64_t last;
  return two ? (int)fmi2_import_do_step(two, time, step, fmi2_true)
             : (int)fmi3_import_do_step(three, time, step, 1, &event, &end, &early, &last);
}

void close_fmu(void) {
  if (two) {
    fmi2_import_terminate(two);
    fmi2_import_free_instance(two);
    fmi2_import_destroy_dllfmu(two);
    fmi2_import_free(two);
  } else {
    fmi3_import_terminate(three);
    fmi3_import_free_instance(three);
    fmi3_import_destroy_dllfmu(three);
    fmi3_import_free(three);
  }
  fmi_import_free_context(context);
}
