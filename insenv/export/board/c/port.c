/* @name@ behind a port: `insenv check c DIR --port ...` feeds it and compares what it answers, to the bit.
 *
 * A request is one letter: S (start), I with the inputs of a sample, O (outputs).  An answer is one byte, the status, after S and O
 * followed by the outputs.  Numbers are doubles in the order of the structs, low byte first, as every Cortex-M has them.  H with eight
 * bytes is answered with these bytes: what comes after them answers the next request.  Other letters are not answered; so as many
 * zeros as inputs have bytes end a request that was cut.  On a board, define OWN_PORT and write the two functions for its serial line;
 * without it they read and write the standard streams.
 */
#include "@name@.h"

#include <stdio.h>
#include <string.h>

#ifdef OWN_PORT
extern int port_read(void *bytes, size_t count); /* wait for `count` bytes; 0: there will be none */
extern void port_write(const void *bytes, size_t count);
#else
static int port_read(void *bytes, size_t count) { return fread(bytes, count, 1, stdin) == 1; }
static void port_write(const void *bytes, size_t count) {
  (void)fwrite(bytes, count, 1, stdout);
  (void)fflush(stdout);
}
#endif

static @name@ filter;
static @name@_inputs inputs;
static @name@_outputs outputs;

static void answer(@name@_status status, int with_outputs) {
  static unsigned char reply[1 + sizeof outputs]; /* in one: a network holds back the second of two small packets */
  reply[0] = (unsigned char)status;
  (void)memcpy(reply + 1, &outputs, sizeof outputs);
  port_write(reply, with_outputs ? sizeof reply : 1);
}

int main(void) {
  unsigned char letter, greeting[8];
  while (port_read(&letter, 1)) {
    if (letter == 'S') {
      @name@_status status = @name@_init(&filter, &@name@_defaults);
      if (status == @NAME@_OK) status = @name@_output(&filter, &outputs);
      answer(status, 1);
    } else if (letter == 'I' && port_read(&inputs, sizeof inputs)) {
      answer(@name@_sample(&filter, &inputs), 0);
    } else if (letter == 'O') {
      answer(@name@_output(&filter, &outputs), 1);
    } else if (letter == 'H' && port_read(greeting, sizeof greeting)) {
      port_write(greeting, sizeof greeting);
    }
  }
  return 0;
}
