/* @name@ as a library of the machine that exports it: many samples in one call. */
#define EXPORT __attribute__((visibility("default")))

EXPORT unsigned long run_size(void) { return sizeof(@name@); }
EXPORT int run_start(@name@ *f, const @name@_parameters *parameters) { return (int)@name@_init(f, parameters); }

/* Outputs after each `every` of `count` samples; at the start if there are none. */
EXPORT int run_samples(@name@ *f, const @name@_inputs *inputs, long count, long every, @name@_outputs *outputs) {
  int status = (count == 0) ? (int)@name@_output(f, outputs) : 0;
  for (long k = 0; (status == 0) && (k < count); ++k) {
    status = (int)@name@_sample(f, &inputs[k]);
    if ((status == 0) && ((k + 1) % every == 0)) { status = (int)@name@_output(f, &outputs[k / every]); }
  }
  return status;
}
