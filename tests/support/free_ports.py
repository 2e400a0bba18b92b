"""Ports for servers that have to be told theirs.

    free_ports.py COUNT: prints them
"""

import random
import socket
import sys


def free_port():
  """Returns a port that nobody has. It is below those that systems give to connections, so none of them takes it
  before the server does."""
  while True:
    port = random.randrange(10000, 32768)
    with socket.socket() as unused:
      try:
        unused.bind(('127.0.0.1', port))
      except OSError:
        continue
    return port


if __name__ == '__main__':
  ports = set()
  while len(ports) < int(sys.argv[1]):
    ports.add(free_port())
  print(*ports)
