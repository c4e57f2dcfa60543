"""A command at a terminal of a given width."""

import fcntl
import os
import pty
import struct
import termios


def at_terminal(command, columns, lines=24, environment=None):
    """Run the command with a terminal as its standard streams; give what it shows there, with the terminal's codes, and its
    wait status."""
    child, terminal = pty.fork()
    if child == 0:
        kept = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES", "NO_COLOR")}
        # the size is set before the command begins
        fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
        # readline sets COLUMNS behind os.environ's back: the environment is given whole
        os.execvpe(command[0], command, {**kept, "TERM": "xterm", **(environment or {})})
    shown = b""
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:  # the child has closed it
            break
        if not part:
            break
        shown += part
    os.close(terminal)
    return shown.decode(errors="replace"), os.waitpid(child, 0)[1]
