"""Python processes that begin with insenv imported: a server imports it once and forks for each.

`Warm` starts the server; `Warm.python` stands for the interpreter in command lines, in a shell too: it is `warm_client.py`,
which hands its arguments, folder, environment and standard streams to the server and ends with the status of the process
that is forked there.  Only ``-m module`` and scripts are understood.  What such a process does not show is the start of
insenv itself, nor a PYTHONPATH of its own: for those an interpreter is started.
"""

import atexit
import contextlib
import gc
import importlib
import io
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

MODULES = "insenv.cli.app", "matplotlib.pyplot", "scipy.optimize"
"""What the server imports besides the public names of insenv and what `insenv list` needs."""
MODELS = {"ship-swaying": ("q-method",), "car-city-drive": ("loosely-coupled",)}
"""Scenarios, and estimators on them, whose source the server writes out: it would be written again in each process."""


class Warm:
    """Context manager: the server.  `python` is the command that stands for the interpreter."""

    def __init__(self, environment: dict[str, str]) -> None:
        self._environment = environment

    def __enter__(self) -> "Warm":
        self._folder = tempfile.TemporaryDirectory()
        address = str(Path(self._folder.name) / "s")
        self.python = [sys.executable, "-I", "-S", str(Path(__file__).with_name("warm_client.py")), address]
        command = [sys.executable, __file__, address]
        self._server = subprocess.Popen(command, env=self._environment, stdout=subprocess.PIPE, start_new_session=True)
        assert self._server.stdout is not None and self._server.stdout.readline() == b"ready\n"
        return self

    def __exit__(self, *error: object) -> None:
        os.killpg(self._server.pid, signal.SIGKILL)  # with what a test that failed has left
        self._server.communicate()
        self._folder.cleanup()


def serve(address: str) -> None:
    """Import, then fork for each request; returns in the process that does the work of one."""
    import insenv
    from insenv.cli import main

    for name in insenv.__all__:
        getattr(insenv, name)
    for module in MODULES:
        importlib.import_module(module)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        main(["list"])
    write_out_models()
    gc.freeze()
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(address)
        listening.listen()
        print("ready", flush=True)
        while True:
            connection, _ = listening.accept()
            if os.fork() == 0:
                break
            connection.close()
            with contextlib.suppress(ChildProcessError):
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
    attend(connection)


def write_out_models() -> None:
    """Look up the libraries of `MODELS`; none is loaded, and no thread is left behind."""
    from insenv.core.compile import library_path
    from insenv.core.runner import resolve_backend
    from insenv.scenario import build, load

    if resolve_backend() == "native":
        for name, estimators in MODELS.items():
            plant = build(load(name))
            for model in (plant.model, *(plant.adapted(id).model for id in estimators)):
                library_path(model)


def attend(connection: socket.socket) -> None:
    """Fork and tell the client the status at the end; returns in the process that does the work, in its client's place."""
    _, streams, _, _ = socket.recv_fds(connection, 1, 3)
    with connection.makefile() as lines:
        request = json.loads(lines.readline())
    if worker := os.fork():
        status = os.waitstatus_to_exitcode(os.waitpid(worker, 0)[1])
        connection.sendall(bytes([status if status >= 0 else 128 - status]))
        os._exit(0)
    connection.close()
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    # what the server's streams know of its own files (that one can be rewound) is not true of the client's
    encoding = sys.stdout.encoding
    sys.stdin = sys.__stdin__ = open(0, encoding=encoding, closefd=False)  # noqa: SIM115 (as long as the process)
    sys.stdout = sys.__stdout__ = open(1, "w", encoding=encoding, closefd=False)  # noqa: SIM115 (as long as the process)
    sys.stderr = sys.__stderr__ = open(2, "w", buffering=1, encoding=encoding, errors="backslashreplace", closefd=False)  # noqa: SIM115 (as long as the process)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    end(request["arguments"])


def work(arguments: list[str]) -> None:
    """What ``python arguments`` does."""
    if arguments[0] == "-m":
        sys.argv, sys.path[0] = arguments[1:], os.getcwd()
        runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
    else:
        sys.argv, sys.path[0] = arguments, str(Path(arguments[0]).resolve().parent)
        runpy.run_path(arguments[0], run_name="__main__")


def end(arguments: list[str]) -> None:
    """Work, and exit as an interpreter does, but leave the modules to the system: to free them would first copy them."""
    status = 0
    try:
        work(arguments)
    except SystemExit as error:
        if error.code is not None and not isinstance(error.code, int):
            print(error.code, file=sys.stderr)
        status = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        sys.excepthook(*sys.exc_info())
        status = 1
    threading._shutdown()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(status)


if __name__ == "__main__":
    serve(sys.argv[1])
