"""A server of files by HTTP/1.1, with ranges, or of objects as S3 lists them, that injects faults.

  with ObjectServer(folder, faults=0.2, seed=7) as server:
    subprocess.run(["isoscope", "info", server.origin + "/head.nrrd"])

A fault is drawn for each request: 503 with Retry-After, 429, 500, a reset, a body that is cut, or a
pause. Requests of the same object get an answer at last: at most `max_faults` faults in a row.
"""

import email.utils
import hashlib
import http.server
import os
import random
import re
import socket
import struct
import threading
import time
import urllib.parse
from xml.sax.saxutils import escape


class Handler(http.server.BaseHTTPRequestHandler):
  protocol_version = "HTTP/1.1"

  def log_message(self, *_):
    pass

  def setup(self):
    super().setup()
    self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

  def answer(self, status, body=b"", headers=()):
    self.send_response(status)
    for name, value in headers:
      self.send_header(name, value)
    if not any(name == "Content-Length" for name, _ in headers):
      self.send_header("Content-Length", str(len(body)))
    self.end_headers()
    self.wfile.write(body)

  def do_GET(self):
    owner = self.server.owner
    path, _, query = self.path.partition("?")
    owner.note(self.path, self.headers)
    if owner.token and self.headers.get("Authorization") != "Bearer " + owner.token:
      self.answer(401)
      return
    if owner.is_s3 and not self.headers.get("Authorization", "").startswith("AWS4-HMAC-SHA256 "):
      self.answer(403)
      return
    fault = owner.draw_fault(path)
    if fault in (429, 500, 503):
      self.answer(fault, b"busy", [("Retry-After", "0")])
      return
    if fault == "reset":
      self.reset()
      return
    if fault == "pause":
      time.sleep(0.05)
    parameters = dict(urllib.parse.parse_qsl(query, keep_blank_values=True))
    if owner.is_s3 and "list-type" in parameters:
      self.list(path, parameters)
      return
    self.serve_file(path, fault)

  def reset(self):
    self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    self.connection.shutdown(socket.SHUT_RD)
    self.close_connection = True
    self.wfile.flush()
    os.close(os.dup(self.connection.fileno()))

  def serve_file(self, path, fault):
    owner = self.server.owner
    name = os.path.join(owner.folder, urllib.parse.unquote(path).lstrip("/"))
    if not os.path.isfile(name):
      if owner.has_index and os.path.isdir(name):
        self.index(name, path)
        return
      self.answer(404, b"<Error/>")
      return
    size = os.path.getsize(name)
    stamp = os.stat(name)
    etag = '"%s"' % hashlib.sha256(b"%d %d" % (stamp.st_mtime_ns, size)).hexdigest()[:16]
    headers = [("Last-Modified", email.utils.formatdate(stamp.st_mtime, usegmt=True))]
    if owner.has_etags:
      headers.append(("ETag", etag))
    wanted = self.headers.get("If-Match")
    if wanted and wanted != etag:
      self.answer(412)
      return
    first, last, status = 0, size - 1, 200
    asked = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range", ""))
    if owner.has_ranges and asked:
      if asked[1]:
        first = int(asked[1])
        last = min(int(asked[2]) if asked[2] else size - 1, size - 1)
      else:
        first = max(size - int(asked[2]), 0)
      if first >= size or first > last:
        self.answer(416, b"", headers + [("Content-Range", "bytes */%d" % size)])
        return
      status = 206
      headers.append(("Content-Range", "bytes %d-%d/%d" % (first, last, size)))
    count = last - first + 1
    self.send_response(status)
    for key, value in headers + [("Content-Length", str(count))]:
      self.send_header(key, value)
    self.end_headers()
    if fault == "cut":
      count //= 2
      self.close_connection = True
    with open(name, "rb") as file:
      file.seek(first)
      while count > 0:
        part = file.read(min(count, 1 << 20))
        if not part:
          break
        owner.pace(len(part))
        self.wfile.write(part)
        count -= len(part)

  def index(self, folder, path):
    names = sorted(os.listdir(folder))
    links = "".join(
      '<a href="%s">%s</a>\n' % (urllib.parse.quote(n) + ("/" if os.path.isdir(os.path.join(folder, n)) else ""), escape(n))
      for n in names)
    body = "<html><body><a href=\"../\">Parent</a>\n<a href=\"?C=N\">Name</a>\n%s</body></html>" % links
    self.answer(200, body.encode(), [("Content-Type", "text/html; charset=utf-8")])

  def list(self, path, parameters):
    """ListObjectsV2 of http://host/BUCKET/?list-type=2&prefix=..., pages of owner.page keys."""
    owner = self.server.owner
    bucket = path.strip("/")
    root = os.path.join(owner.folder, bucket)
    prefix = parameters.get("prefix", "")
    keys = []
    for folder, _, files in os.walk(root):
      for file in files:
        key = os.path.relpath(os.path.join(folder, file), root)
        if key.startswith(prefix):
          keys.append(key)
    keys.sort(key=lambda key: key.encode())
    after = parameters.get("continuation-token", "")
    keys = [key for key in keys if key > after]
    page, rest = keys[:owner.page], keys[owner.page:]
    is_encoded = parameters.get("encoding-type") == "url"
    quote = urllib.parse.quote if is_encoded else escape
    body = "".join(
      "<Contents><Key>%s</Key><Size>%d</Size></Contents>"
      % (quote(key), os.path.getsize(os.path.join(root, key))) for key in page)
    more = ("<IsTruncated>true</IsTruncated><NextContinuationToken>%s</NextContinuationToken>"
        % escape(page[-1]) if rest else "<IsTruncated>false</IsTruncated>")
    more += "<EncodingType>url</EncodingType>" if is_encoded else ""
    self.answer(200, ('<?xml version="1.0" encoding="UTF-8"?><ListBucketResult>%s%s'
                          "</ListBucketResult>" % (more, body)).encode(),
          [("Content-Type", "application/xml")])


class Server(http.server.ThreadingHTTPServer):
  daemon_threads = True

  def handle_error(self, *_):
    pass


class ObjectServer:
  def __init__(self, folder, faults=0.0, seed=1, max_faults=3, has_ranges=True, has_etags=True,
                 has_index=False, is_s3=False, token="", page=1000, bytes_per_second=0):
    self.folder = folder
    self.faults = faults
    self.max_faults = max_faults
    self.has_ranges = has_ranges
    self.has_etags = has_etags
    self.has_index = has_index
    self.is_s3 = is_s3
    self.token = token
    self.page = page
    self.bytes_per_second = bytes_per_second
    self.fault_count = 0
    self.requests = []
    self._random = random.Random(seed)
    self._row = {}
    self._lock = threading.Lock()
    self._server = Server(("127.0.0.1", 0), Handler)
    self._server.owner = self
    self.origin = "http://127.0.0.1:%d" % self._server.server_address[1]
    self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

  def __enter__(self):
    self._thread.start()
    return self

  def __exit__(self, *_):
    self._server.shutdown()
    self._server.server_close()
    self._thread.join()

  def note(self, path, headers):
    with self._lock:
      self.requests.append((path, dict(headers)))

  def draw_fault(self, path):
    """None, or what goes wrong with this request."""
    with self._lock:
      row = self._row.get(path, 0)
      if row >= self.max_faults or self._random.random() >= self.faults:
        self._row[path] = 0
        return None
      self._row[path] = row + 1
      self.fault_count += 1
      return self._random.choice([429, 500, 503, "reset", "cut", "pause"])

  def pace(self, size):
    if self.bytes_per_second:
      time.sleep(size / self.bytes_per_second)


if __name__ == "__main__":
  import sys
  with ObjectServer(sys.argv[1], has_ranges="--no-ranges" not in sys.argv,
                      has_index="--index" in sys.argv, is_s3="--s3" in sys.argv) as server:
    print(server.origin, flush=True)
    threading.Event().wait()
