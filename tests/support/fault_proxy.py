"""An HTTP proxy in front of one server, which does wrong at random: for tests of what reads from addresses.

A request is passed on as it is, Host included, so that signatures stay right. With the given chance the answer is
spoilt by one of FAULTS. Some faults are honest (the right answer, late or in pieces): a reader must then succeed; most
can be mended by asking again; others may only end in an error. None may end in other bytes.

    proxy = FaultProxy(('127.0.0.1', 8080), chance=0.2, seed=1)
    proxy.port, proxy.counts, proxy.close()
"""

import collections
import http.client
import http.server
import random
import socket
import struct
import threading
import time

HEADS = ('content-type', 'content-range', 'etag', 'last-modified', 'accept-ranges', 'x-amz-bucket-region')


class StrangerServer:
    """Another host, where redirects lead. Keeps what it is told, and answers with bytes that are wrong."""

    def __init__(self):
        outer = self
        self.told = []

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = 'HTTP/1.1'

            def do_GET(self):
                outer.told.append(f'{self.requestline}\n{self.headers}')
                body = b'!' * 4096
                self.send_response(206 if 'Range' in self.headers else 200)
                self.send_header('Content-Length', str(len(body)))
                self.send_header('Content-Range', f'bytes 0-{len(body) - 1}/{len(body)}')
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Handler)
        self.port = self.server.server_address[1]
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()


class FaultProxy:
    """Thread-safe. `counts` has the faults by name, `requests` the number of all requests."""

    def __init__(self, upstream, chance, seed, stranger=None, certificate=None):
        self.upstream, self.chance, self.stranger = upstream, chance, stranger
        self.random = random.Random(seed)
        self.lock = threading.Lock()
        self.counts = collections.Counter()
        self.requests = 0
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = 'HTTP/1.1'

            def do_GET(self):
                outer.serve(self)

            def log_message(self, *_):
                pass

        class Server(http.server.ThreadingHTTPServer):
            daemon_threads = True
            request_queue_size = 128

            def handle_error(self, *_):
                pass

        self.server = Server(('127.0.0.1', 0), Handler)
        if certificate:
            import ssl
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(*certificate)
            self.server.socket = context.wrap_socket(self.server.socket, server_side=True, do_handshake_on_connect=False)
        self.port = self.server.server_address[1]
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()

    def draw(self):
        """The fault of a request, or None, and a number in [0, 1) for it."""
        with self.lock:
            self.requests += 1
            fault = self.random.choice(FAULTS) if self.random.random() < self.chance else None
            if fault:
                self.counts[fault.__name__] += 1
            return fault, self.random.random()

    def ask(self, request):
        """The server's own answer: status, headers, body."""
        connection = http.client.HTTPConnection(*self.upstream, timeout=60)
        try:
            connection.putrequest(request.command, request.path, skip_host=True, skip_accept_encoding=True)
            for name, value in request.headers.items():
                if name.lower() not in ('connection', 'keep-alive'):
                    connection.putheader(name, value)
            connection.endheaders()
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def serve(self, request):
        fault, number = self.draw()
        status, headers, body = self.ask(request)
        if fault is None or fault(self, request, status, headers, body, number) == 'honest':
            send(request, status, headers, body)


def send(request, status, headers, body, changes=(), head_cut=None, body_cut=None):
    """Sends an answer; `changes` are of headers, None leaves one out. A cut: only so many bytes of it, then the end."""
    fields = {name.lower(): value for name, value in headers.items() if name.lower() in HEADS}
    fields.update(dict(changes))
    fields['content-length'] = str(len(body))
    lines = [f'HTTP/1.1 {status} X'] + [f'{name}: {value}' for name, value in fields.items() if value is not None]
    head = ('\r\n'.join(lines) + '\r\n\r\n').encode('latin-1')
    if head_cut is not None or body_cut is not None:
        request.close_connection = True
    request.wfile.write(head[:head_cut] if head_cut is not None else head + body[:body_cut])
    request.wfile.flush()


def reset(request):
    request.close_connection = True
    request.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
    request.connection.close()


def resets(proxy, request, *_):
    reset(request)


def closes(proxy, request, *_):
    request.close_connection = True


def cuts_head(proxy, request, status, headers, body, number):
    send(request, status, headers, body, head_cut=int(number * 60))


def cuts_body(proxy, request, status, headers, body, number):
    send(request, status, headers, body, body_cut=int(number * len(body)))


def resets_in_body(proxy, request, status, headers, body, number):
    send(request, status, headers, body, body_cut=int(number * len(body)))
    reset(request)


def throttles(proxy, request, status, headers, body, number):
    send(request, (429, 503)[int(number * 2)], {}, b'<Error><Code>SlowDown</Code></Error>', [('retry-after', str(int(number * 10) % 2))])


def fails(proxy, request, status, headers, body, number):
    send(request, (500, 502, 504, 408)[int(number * 4)], {}, b'no')


def refuses(proxy, request, status, headers, body, number):
    send(request, (400, 401, 403, 404)[int(number * 4)], {}, request.headers.get('Authorization', 'none').encode())


def stalls(proxy, request, status, headers, body, number):
    time.sleep(number * 1.5)
    return 'honest'


def ends_late(proxy, request, status, headers, body, number):
    send(request, status, headers, body, body_cut=int(number * len(body)))
    time.sleep(number)  # the rest never comes


def sends_pieces(proxy, request, status, headers, body, number):
    fields = ''.join(f'{name}: {value}\r\n' for name, value in headers.items() if name.lower() in HEADS)
    request.wfile.write(f'HTTP/1.1 {status} X\r\n{fields}Transfer-Encoding: chunked\r\n\r\n'.encode('latin-1'))
    for at in range(0, len(body), 50000):
        piece = body[at:at + 50000]
        request.wfile.write(b'%x\r\n%s\r\n' % (len(piece), piece))
    request.wfile.write(b'0\r\n\r\n')


def sends_more(proxy, request, status, headers, body, number):
    fields = ''.join(f'{name}: {value}\r\n' for name, value in headers.items() if name.lower() in HEADS)
    more = body + b'more'
    request.wfile.write(f'HTTP/1.1 {status} X\r\n{fields}Transfer-Encoding: chunked\r\n\r\n{len(more):x}\r\n'.encode('latin-1')
                        + more + b'\r\n0\r\n\r\n')
    request.close_connection = True


def sends_fewer(proxy, request, status, headers, body, number):
    send(request, status, headers, body[:int(number * len(body))])


def shifts_the_range(proxy, request, status, headers, body, number):
    told = headers.get('Content-Range', 'bytes 0-9/10')
    first, rest = told.split(' ')[1].split('-')
    last, total = rest.split('/')
    send(request, 206, headers, bytes(len(body)), [('content-range', f'bytes {int(first) + 1}-{int(last) + 1}/{total}')])


def ignores_the_range(proxy, request, status, headers, body, number):
    if 'Range' not in request.headers:
        return 'honest'
    send(request, 200, headers, bytes(len(body) + 1000), [('content-range', None)])


def has_changed(proxy, request, status, headers, body, number):
    if 'Range' not in request.headers:
        return 'honest'  # a whole object has no version before it
    send(request, status, headers, bytes(len(body)), [('etag', '"another"'), ('last-modified', 'Mon, 02 Jan 2006 15:04:05 GMT')])


def has_grown(proxy, request, status, headers, body, number):
    told = headers.get('Content-Range')
    if told is None:
        return 'honest'
    send(request, status, headers, bytes(len(body)), [('content-range', told.split('/')[0] + '/999999999'), ('etag', '"grown"')])


def redirects_to_a_stranger(proxy, request, status, headers, body, number):
    send(request, (301, 302, 307, 308)[int(number * 4)], {}, b'', [('location', f'http://localhost:{proxy.stranger.port}/x?{request.path}')])


def redirects_to_a_file(proxy, request, *_):
    send(request, 302, {}, b'', [('location', 'file:///etc/passwd')])


def redirects_to_the_cloud(proxy, request, *_):
    send(request, 302, {}, b'', [('location', 'http://169.254.169.254/latest/meta-data/')])


def redirects_to_itself(proxy, request, *_):
    send(request, 302, {}, b'', [('location', request.path)])


def is_no_http(proxy, request, status, headers, body, number):
    request.wfile.write(random.Random(number).randbytes(300) + b'\n')
    request.close_connection = True


def has_endless_headers(proxy, request, status, headers, body, number):
    request.close_connection = True
    try:
        request.wfile.write(b'HTTP/1.1 206 X\r\n')
        for _ in range(400):
            request.wfile.write(b'X-Long: ' + b'y' * 4000 + b'\r\n')
    except OSError:
        pass


def encodes(proxy, request, status, headers, body, number):
    send(request, status, headers, bytes(len(body)), [('content-encoding', 'br')])


FAULTS = [resets, closes, cuts_head, cuts_body, resets_in_body, throttles, fails, refuses, stalls, ends_late, sends_pieces, sends_more,
          sends_fewer, shifts_the_range, ignores_the_range, has_changed, has_grown, redirects_to_a_stranger, redirects_to_a_file,
          redirects_to_the_cloud, redirects_to_itself, is_no_http, has_endless_headers, encodes]
