#!/usr/bin/env python3
"""The OpenAPI document of a real `isoscope view` against its answers, by a client that is made of the document.

    openapi_test.py ISOSCOPE [unittest arguments]

The client knows no address, no parameter and no message: what the document does not say, it can't ask for. Each JSON
answer has to fit its schema, and may have no member beyond it.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import unittest
import urllib.error
import urllib.parse
import urllib.request

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from png_rows import read_png  # noqa: E402

ISOSCOPE = os.path.abspath(sys.argv.pop(1)) if len(sys.argv) > 1 else 'isoscope'
PATIENCE_S = 240  # far above what is needed
SIDE = {'width': 320, 'height': 240}
TYPES = {'string': str, 'integer': int, 'number': (int, float), 'boolean': bool, 'array': list, 'object': dict}


def problems(schema, value, document, at='answer'):
    """What of a value does not fit a schema, as sentences. A member that the schema does not name is wrong."""
    if '$ref' in schema:
        return problems(resolve(schema, document), value, document, at)
    if 'oneOf' in schema:
        fits = [one for one in schema['oneOf'] if not problems(one, value, document, at)]
        return [] if len(fits) == 1 else [f'{at}: {value!r} fits {len(fits)} of {schema["oneOf"]}']
    kind = schema['type']
    if not isinstance(value, TYPES[kind]) or (isinstance(value, bool) and kind != 'boolean'):
        return [f'{at}: {value!r} is no {kind}']
    if 'enum' in schema and value not in schema['enum']:
        return [f'{at}: {value!r} is none of {schema["enum"]}']
    if 'pattern' in schema and not re.search(schema['pattern'], value):
        return [f'{at}: {value!r} does not match {schema["pattern"]}']
    if kind == 'array':
        return [line for i, item in enumerate(value) for line in problems(schema['items'], item, document, f'{at}[{i}]')]
    if kind != 'object':
        return []
    known = schema.get('properties', {})
    found = [f'{at}: {name} is missing' for name in schema.get('required', []) if name not in value]
    for name, member in value.items():
        found += problems(known[name], member, document, f'{at}.{name}') if name in known else [
            f'{at}: the schema has no {name}']
    return found


def resolve(part, document):
    """The part of the document that a reference names, or the part itself."""
    while '$ref' in part:
        names = part['$ref'].removeprefix('#/').split('/')
        part = document
        for name in names:
            part = part[name]
    return part


class Client:
    """A method for each operation: client.call('getPicture', name='head', isovalue=60)."""

    def __init__(self, address, token, document):
        self.base = urllib.parse.urljoin(address, document['servers'][0]['url'])
        self.token, self.document = token, document
        self.operations = {operation['operationId']: (path, method, operation)
                           for path, methods in document['paths'].items() for method, operation in methods.items()}

    def call(self, operation_id, /, body=None, **parameters):
        """(status, type, bytes, headers). Checks what it sends, and what comes, by the document."""
        path, method, operation = self.operations[operation_id]
        query = []
        for parameter in operation['parameters']:
            value = parameters.pop(parameter['name'].replace('-', '_'), None)
            if parameter['in'] == 'path':
                path = path.replace(f'{{{parameter["name"]}}}', urllib.parse.quote(value, safe=''))
            elif value is not None:
                found = problems(parameter['schema'], value, self.document, parameter['name'])
                assert not found, found
                values = value if isinstance(value, list) else [value]
                query += [(parameter['name'], str(v).lower() if isinstance(v, bool) else v) for v in values]
        assert not parameters, f'{operation_id} has no {parameters}'
        data = None
        if body is not None:
            schema = operation['requestBody']['content']['application/json']['schema']
            found = problems(schema, body, self.document, 'body')
            assert not found, found
            data = json.dumps(body).encode()
        address = self.base.rstrip('/') + path + ('?' + urllib.parse.urlencode(query) if query else '')
        return self.ask(operation, urllib.request.Request(
            address, data=data, method=method.upper(), headers={'Authorization': f'Bearer {self.token}'}))

    def ask(self, operation, request):
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as reply:
                answer = reply.status, reply.headers['Content-Type'], reply.read(), reply.headers
        except urllib.error.HTTPError as error:
            with error:
                answer = error.code, error.headers['Content-Type'], error.read(), error.headers
        status, kind, content, headers = answer
        said = resolve(operation['responses'].get(str(status), operation['responses']['default']), self.document)
        assert kind in said['content'], f'{request.full_url}: {status} {kind}, and the document has {list(said["content"])}'
        schema = said['content'][kind].get('schema')
        if schema:
            found = problems(schema, json.loads(content), self.document)
            assert not found, found
        for name in (name for name in headers if name.startswith('X-Isoscope-')):
            assert name in said['headers'], name
        return answer


class OpenApiTest(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix='isoscope-openapi-')
        cls.environment = {**os.environ, 'XDG_CACHE_HOME': cls.folder.name}
        cls.volume = os.path.join(cls.folder.name, 'g.nrrd')
        subprocess.run([ISOSCOPE, 'generate', 'gyroid', '--dims', '24,24,24', '--type', 'uint8', '--output', cls.volume],
                       check=True, stdout=subprocess.DEVNULL)
        cls.server = subprocess.Popen([ISOSCOPE, 'view', cls.volume, '--no-open', '--listen', '127.0.0.1:0',
                                       '--renderer', 'cpu', '--allow-origin', 'https://hub.example.org'],
                                      stdout=subprocess.PIPE, text=True, env=cls.environment)
        cls.url = cls.server.stdout.readline().strip()
        assert cls.url, f'isoscope view {cls.volume} did not start'
        query = urllib.parse.parse_qs(urllib.parse.urlsplit(cls.url).query)
        cls.dataset, cls.token = query['dataset'][0], query['token'][0]
        address = urllib.parse.urljoin(cls.url, '/v1/openapi.json')
        request = urllib.request.Request(address, headers={'Authorization': f'Bearer {cls.token}'})
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as reply:
            cls.document = json.load(reply)
        cls.client = Client(address, cls.token, cls.document)

    @classmethod
    def tearDownClass(cls):
        cls.server.terminate()
        cls.server.wait()
        cls.server.stdout.close()
        cls.folder.cleanup()

    def good(self, operation_id, /, **arguments):
        status, kind, content, headers = self.client.call(operation_id, **arguments)
        self.assertEqual(status, 200, content[:500])
        return kind, content, headers

    def frame(self):
        return {'isovalue': 128, 'viewport': {'widthPx': SIDE['width'], 'heightPx': SIDE['height']}}

    def test_each_operation_answers_as_the_document_says(self):
        for name, (_, method, operation) in self.client.operations.items():
            arguments = {}
            if any(parameter['in'] == 'path' for parameter in operation['parameters']):
                arguments['name'] = self.dataset
            for parameter in operation['parameters']:
                if parameter['name'] == 'isovalue':  # that of a film may be a range, which is text
                    arguments['isovalue'] = '128' if parameter['schema']['type'] == 'string' else 128
            if method == 'post':
                arguments['body'] = self.frame() if name == 'renderPicture' else {
                    'frame': self.frame(), 'pixels': [{'x': 160, 'y': 120}]}
            with self.subTest(operation=name):
                self.good(name, **arguments)

    def test_errors_have_their_schema(self):
        for name, arguments, status in (('getDataset', {'name': 'none'}, 404),
                                        ('getPicture', {'name': self.dataset}, 400),
                                        ('getHistogram', {'name': self.dataset, 'bins': 5000}, 400),
                                        ('pick', {'name': self.dataset, 'body': {'frame': {'isovalue': 1}}}, 400)):
            with self.subTest(operation=name):
                self.assertEqual(self.client.call(name, **arguments)[0], status)

    def test_no_parameter_is_read_that_the_document_lacks(self):
        address = urllib.parse.urljoin(self.url, f'/v1/datasets/{urllib.parse.quote(self.dataset)}/')
        for path, name in (('render', 'getPicture'), ('histogram', 'getHistogram'), ('mesh.ply', 'getMeshPly'),
                           ('film.webp', 'getFilmWebp')):
            request = urllib.request.Request(f'{address}{path}?none=1', headers={'Authorization': f'Bearer {self.token}'})
            with self.assertRaises(urllib.error.HTTPError) as raised:
                urllib.request.urlopen(request, timeout=PATIENCE_S)
            with raised.exception as error:
                said = json.load(error)['message'].split('there are: ')[1].split(', ')
            _, _, operation = self.client.operations[name]
            self.assertEqual(said, sorted(p['name'] for p in operation['parameters'] if p['in'] == 'query'))

    def test_choices_and_numbers_of_a_picture_are_taken(self):
        _, _, operation = self.client.operations['getPicture']
        for parameter in operation['parameters']:
            name = parameter['name'].replace('-', '_')
            beside = {'light_space': {'light': ['0,0,1']}, 'color_range': {'color_by': ['z']}}.get(name, {})
            for choice in parameter['schema'].get('enum', []):
                with self.subTest(parameter=name, choice=choice):
                    self.good('getPicture', name=self.dataset, isovalue=128, **SIDE, **beside, **{name: choice})
        self.good('getPicture', name=self.dataset, isovalue=128, azimuth=30, zoom=1.5, max_layers=2, **SIDE)

    def test_a_picture_is_the_one_of_the_command_line(self):
        path = os.path.join(self.folder.name, 'plain.png')
        subprocess.run([ISOSCOPE, 'render', self.volume, '--isovalue', '128', '--azimuth', '0', '--width', '320', '--height', '240',
                        '--renderer', 'cpu', '--no-metadata', '-o', path], check=True, env=self.environment, stdout=subprocess.DEVNULL)
        kind, picture, _ = self.good('getPicture', name=self.dataset, isovalue=128, **SIDE)
        self.assertEqual(kind, 'image/png')
        with open(path, 'rb') as file:
            self.assertEqual(picture, file.read())

    def test_annotations_are_drawn_and_the_record_makes_the_picture_again(self):
        plain = self.good('getPicture', name=self.dataset, isovalue=128, color_by=['z'], **SIDE)[1]
        _, drawn, headers = self.good('getPicture', name=self.dataset, isovalue=128, color_by=['z'], axes=True, scale_bar=True,
                                      legend=True, caption='at {isovalue}', record=True, **SIDE)
        path = os.path.join(self.folder.name, 'drawn.png')
        bare = os.path.join(self.folder.name, 'bare.png')
        for name, content in ((path, drawn), (bare, plain)):
            with open(name, 'wb') as file:
                file.write(content)
        changed = sum(a != b for rows in zip(read_png(path)[1], read_png(bare)[1]) for a, b in zip(*rows))
        self.assertGreater(changed, 500)
        self.assertIn('no-cache', headers['Cache-Control'])
        again = subprocess.run([ISOSCOPE, 'render', self.volume, '--renderer', 'cpu', '--like', path, '-o',
                                os.path.join(self.folder.name, 'again.png')], capture_output=True, text=True, env=self.environment)
        self.assertEqual(again.returncode, 0, again.stdout + again.stderr)
        posted = self.good('renderPicture', name=self.dataset, body=self.frame(), caption='posted')[1]
        self.assertNotEqual(posted, self.good('renderPicture', name=self.dataset, body=self.frame())[1])

    def test_annotations_that_cannot_be_are_refused(self):
        for arguments, said in (({'legend': True}, 'color-by'), ({'axes': True, 'format': 'jpeg'}, 'PNG'),
                                ({'record': True, 'culling': 'mask'}, 'mask'),
                                ({'axes': True, 'width': 8192, 'height': 8192}, '33554432')):
            status, _, content, _ = self.client.call('getPicture', name=self.dataset, isovalue=128, **arguments)
            self.assertEqual(status, 400)
            self.assertIn(said, json.loads(content)['message'])

    def test_meshes_are_files_of_their_formats(self):
        begins = {'getMeshPly': b'ply\n', 'getMeshStl': b'isoscope, binary STL', 'getMeshObj': b'# isoscope', 'getMeshGlb': b'glTF',
                  'getMeshVtp': b'<?xml'}
        self.assertEqual(set(begins), {name for name in self.client.operations if name.startswith('getMesh')})
        for name, begin in begins.items():
            with self.subTest(operation=name):
                _, mesh, headers = self.good(name, name=self.dataset, isovalue=128)
                self.assertEqual(mesh[:len(begin)], begin)
                suffix = name.removeprefix('getMesh').lower()
                self.assertIn(f'mesh.{suffix}', headers['Content-Disposition'])
                # The command line writes the same file.
                path = os.path.join(self.folder.name, f'm.{suffix}')
                subprocess.run([ISOSCOPE, 'export', self.volume, '--isovalue', '128', '-o', path], check=True,
                               env=self.environment, stdout=subprocess.DEVNULL)
                with open(path, 'rb') as file:
                    self.assertEqual(mesh, file.read())
        self.assertEqual(self.client.call('getMeshStl', name=self.dataset, isovalue=128, color='teal')[0], 400)

    def rendered(self, name, *flags):
        """The file that `isoscope render` writes."""
        path = os.path.join(self.folder.name, name)
        subprocess.run([ISOSCOPE, 'render', self.volume, '--width', '320', '--height', '240', '--renderer', 'cpu',
                        '-o', path, *flags], check=True, env=self.environment, stdout=subprocess.DEVNULL)
        with open(path, 'rb') as file:
            return file.read()

    def test_films_are_those_of_the_command_line(self):
        turn = {'isovalue': '128', 'repeat': 3, 'orbit': 25, 'azimuth': 30, 'fps': 7.5, 'axes': True, 'caption': 'at {isovalue}'}
        levels = {'isovalue': '110:140:15', 'view': 'front', 'color_by': ['gradient'], 'color_range': 'visible', 'legend': True}
        clear = {'isovalue': '128', 'repeat': 2, 'orbit': 90, 'azimuth': 0, 'background': '0,0,0,0'}
        for arguments in (turn, levels, clear):
            flags = []
            for name, value in arguments.items():
                flag = '--' + name.replace('_', '-')
                flags += [flag] if value is True else [f'{flag}={value[0] if isinstance(value, list) else value}']
            for suffix in ('webp', 'apng'):
                with self.subTest(suffix=suffix, flags=flags):
                    kind, film, headers = self.good(f'getFilm{suffix.capitalize()}', name=self.dataset, **SIDE, **arguments)
                    self.assertEqual(kind, f'image/{suffix}')
                    self.assertIn(f'film.{suffix}', headers['Content-Disposition'])
                    self.assertEqual(film, self.rendered(f'film.{suffix}', *flags))

    def test_films_are_bounded(self):
        for arguments, said in (({'repeat': 721}, '721'), ({'repeat': 720, 'width': 1920, 'height': 1080}, '1492992000'),
                                ({'orbit': 5}, 'repeat'), ({'width': 16384, 'height': 16}, '16383')):
            status, _, content, _ = self.client.call('getFilmWebp', name=self.dataset, isovalue='128', **arguments)
            self.assertEqual(status, 400)
            self.assertIn(said, json.loads(content)['message'])

    def test_a_webp_is_a_lossless_picture(self):
        png = self.good('getPicture', name=self.dataset, isovalue=128, **SIDE)[2]
        kind, webp, headers = self.good('getPicture', name=self.dataset, isovalue=128, format='webp', **SIDE)
        self.assertEqual((kind, webp[:4], webp[8:16]), ('image/webp', b'RIFF', b'WEBPVP8L'))
        self.assertNotEqual(headers['ETag'], png['ETag'])
        drawn = self.good('getPicture', name=self.dataset, isovalue=128, format='webp', axes=True, **SIDE)[1]
        self.assertEqual(drawn[8:16], b'WEBPVP8L')
        self.assertNotEqual(drawn, webp)
        self.assertEqual(self.client.call('getPicture', name=self.dataset, isovalue=128, format='webp', record=True)[0], 400)

    def test_pages_of_named_origins_may_ask_a_view(self):
        for origin, status in (('https://hub.example.org', 200), ('https://other.example.org', 403)):
            request = urllib.request.Request(urllib.parse.urljoin(self.url, '/v1/datasets'),
                                             headers={'Authorization': f'Bearer {self.token}', 'Origin': origin})
            try:
                with urllib.request.urlopen(request, timeout=PATIENCE_S) as reply:
                    self.assertEqual((reply.status, reply.headers['Access-Control-Allow-Origin']), (status, origin))
            except urllib.error.HTTPError as error:
                with error:
                    self.assertEqual(error.code, status)


if __name__ == '__main__':
    unittest.main(argv=sys.argv[:1] + sys.argv[1:], verbosity=2)
