"""A server program on a port that it chooses itself, so that no two tests want the same one."""

import re
import signal
import subprocess
import threading

PATIENCE_S = 240  # far above what is needed


class Server:
  """A server program, and the address that it logs; None if it ended before it had one."""

  def __init__(self, program, *arguments):
    self.process = subprocess.Popen([program, '--listen', '127.0.0.1:0', *arguments], stderr=subprocess.PIPE, text=True)
    self.lines = []
    self.address = None
    started = threading.Event()

    def follow():
      for line in self.process.stderr:
        self.lines.append(line)
        found = re.search(r'_started .*address=(\S+)', line)
        if found:
          self.address = found[1]
          started.set()
      started.set()

    self._follower = threading.Thread(target=follow, daemon=True)
    self._follower.start()
    started.wait(PATIENCE_S)

  def stop(self):
    if self.process.poll() is None:
      self.process.send_signal(signal.SIGINT)
    try:
      self.process.wait(PATIENCE_S)
    finally:
      self.kill()

  def kill(self):
    self.process.kill()
    self.process.wait()
    self._follower.join()
    self.process.stderr.close()
