"""The client of `warm.py`: ``python warm_client.py address arguments`` does there what ``python arguments`` does here.

It imports little, so that it starts in milliseconds.
"""

import json
import os
import socket
import sys


def ask(address: str, arguments: list[str]) -> int:
    """The exit status of a process of the server, which has this one's folder, environment and standard streams."""
    request = {"arguments": arguments, "folder": os.getcwd(), "environment": dict(os.environ)}
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(address)
        socket.send_fds(connection, [b"."], [0, 1, 2])
        connection.sendall(json.dumps(request).encode() + b"\n")
        return connection.recv(1)[0]


if __name__ == "__main__":
    sys.exit(ask(sys.argv[1], sys.argv[2:]))
