/* Reset, vectors and a counter of instructions of Arm's MPS2 board with a Cortex-M7 (AN500), as qemu emulates it.
 *
 * qemu runs one instruction in 1024 ns (-icount shift=10), and the SysTick timer counts at 25 MHz: 25.6 counts an instruction.
 */
#include <stdint.h>

#define SYST_CSR (*(volatile uint32_t *)0xE000E010u)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014u)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018u)
#define CPACR (*(volatile uint32_t *)0xE000ED88u)
#define COUNTS_PER_INSTRUCTION 25.6

extern char stack_top[];
extern void _start(void);
unsigned long instructions(void);
void reset(void);
void stop(void);

/* Instructions since the reset; two calls may lie half a million instructions apart. */
unsigned long instructions(void) {
  static uint32_t last = 0xFFFFFFu;
  static double counts;
  const uint32_t now = SYST_CVR;
  counts += (double)((last - now) & 0xFFFFFFu);
  last = now;
  return (unsigned long)(counts / COUNTS_PER_INSTRUCTION);
}

void reset(void) {
  CPACR |= 0xFu << 20; /* the floating-point unit */
  __asm volatile("dsb\n isb");
  SYST_RVR = 0xFFFFFFu;
  SYST_CVR = 0;
  SYST_CSR = 5; /* on, at the processor's clock */
  _start();
}

void stop(void) {
  for (;;) {
  }
}

__attribute__((section(".vectors"), used)) static const struct {
  char *stack;
  void (*handlers[15])(void);
} vectors = {stack_top, {reset, stop, stop, stop, stop, stop, 0, 0, 0, 0, stop, stop, 0, stop, stop}};
