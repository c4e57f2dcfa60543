/* Reset, vectors and a counter of instructions of Arm's MPS2 board with a Cortex-M7 (AN500), as qemu emulates it.
 *
 * qemu runs one instruction in 1024 ns (-icount shift=10), and the SysTick timer counts at 25 MHz: 25.6 counts an instruction.
 */
#include <stddef.h>
#include <stdint.h>

#define SYST_CSR (*(volatile uint32_t *)0xE000E010u)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014u)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018u)
#define CPACR (*(volatile uint32_t *)0xE000ED88u)
#define UART_DATA (*(volatile uint32_t *)0x40004000u)
#define UART_STATE (*(volatile uint32_t *)0x40004004u) /* 1: transmitter full, 2: something received */
#define UART_CTRL (*(volatile uint32_t *)0x40004008u)
#define UART_BAUDDIV (*(volatile uint32_t *)0x40004010u)
#define COUNTS_PER_INSTRUCTION 25.6

extern char stack_top[];
extern void _start(void);
unsigned long instructions(void);
int port_read(void *bytes, size_t count);
void port_write(const void *bytes, size_t count);
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

/* The port of port.c: the first serial line. */
int port_read(void *bytes, size_t count) {
  for (size_t i = 0; i < count; ++i) {
    while ((UART_STATE & 2u) == 0) {
    }
    ((unsigned char *)bytes)[i] = (unsigned char)UART_DATA;
  }
  return 1;
}

void port_write(const void *bytes, size_t count) {
  for (size_t i = 0; i < count; ++i) {
    while ((UART_STATE & 1u) != 0) {
    }
    UART_DATA = ((const unsigned char *)bytes)[i];
  }
}

void reset(void) {
  CPACR |= 0xFu << 20; /* the floating-point unit */
  __asm volatile("dsb\n isb");
  UART_BAUDDIV = 16;
  UART_CTRL = 3; /* transmitter and receiver */
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
