#!/usr/bin/env python3
"""Colours where a field has no value, and the words about surfaces that do not show, by the real programs.

    missing_values_test.py BIN_FOLDER [unittest arguments]

A ball in a volume of two steps. Its colours are the coordinate x, which some samples lack, or which is infinite there.
"""

import base64
import json
import math
import os
import struct
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from png_rows import read_png  # noqa: E402

BIN = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 else '.')
DIMS = (24, 20, 18)
CENTER = (11.5, 9.5, 8.5)
GREY = (128, 128, 128)
VIEW = ['--renderer', 'cpu', '--no-metadata']
SMALL = ['--width', '120', '--height', '100']
WIDE = ['--width', '400', '--height', '300']


def grid(value):
    """Little-endian floats of value(x, y, z), x fastest."""
    return b''.join(struct.pack('<f', value(x, y, z))
                    for z in range(DIMS[2]) for y in range(DIMS[1]) for x in range(DIMS[0]))


def ball(x, y, z):
    return 7 - math.dist((x, y, z), CENTER)


def vti(path, arrays):
    """Writes a .vti of float32 arrays."""
    extent = ' '.join(f'0 {n - 1}' for n in DIMS)
    data = ''.join(
        f'<DataArray type="Float32" Name="{name}" format="binary">'
        f'{base64.b64encode(struct.pack("<Q", len(raw)) + raw).decode()}</DataArray>' for name, raw in arrays.items())
    with open(path, 'w', encoding='utf-8') as file:
        file.write('<?xml version="1.0"?><VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" '
                   f'header_type="UInt64"><ImageData WholeExtent="{extent}" Origin="0 0 0" Spacing="1 1 1">'
                   f'<Piece Extent="{extent}"><PointData>{data}</PointData></Piece></ImageData></VTKFile>')


def nrrd(path, raw, kind='float'):
    header = (f'NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {DIMS[0]} {DIMS[1]} {DIMS[2]}\nendian: little\n'
              'encoding: raw\n\n')
    with open(path, 'wb') as file:
        file.write(header.encode() + raw)


class MissingValuesTest(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        os.environ['XDG_CACHE_HOME'] = os.path.join(cls.folder.name, 'cache')
        holes = grid(lambda x, y, z: math.nan if x < 8 else x)
        ends = grid(lambda x, y, z: -math.inf if x < 8 else math.inf if x > 16 else x)
        for step, shift in ((0, 0), (1, 3)):
            vti(cls.path(f'{step}.vti'), {'p': grid(lambda x, y, z, shift=shift: ball(x, y, z) + shift),
                                          'holes': holes, 'ends': ends})
        with open(cls.path('run.pvd'), 'w', encoding='utf-8') as file:
            file.write('<?xml version="1.0"?><VTKFile type="Collection" version="0.1"><Collection>'
                       '<DataSet timestep="0" file="0.vti"/><DataSet timestep="1" file="1.vti"/></Collection></VTKFile>')
        for count in (1, 3):
            cls.output_of('partition', cls.path('run.pvd'), '--output', cls.path(f'run{count}'), '--shards', str(count))
        cls.run_ = cls.path('run1')
        nrrd(cls.path('labels.nrrd'),
             bytes(0 if ball(x, y, z) < 0 else 3 if x < 12 else 7
                   for z in range(DIMS[2]) for y in range(DIMS[1]) for x in range(DIMS[0])), 'uint8')
        # 0 and 10, with missing samples between them.
        nrrd(cls.path('gap.nrrd'), grid(lambda x, y, z: 0 if x < 10 else math.nan if x < 12 else 10))
        nrrd(cls.path('nan.nrrd'), grid(lambda x, y, z: math.nan))

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder.name, name)

    @staticmethod
    def call(*arguments):
        return subprocess.run([os.path.join(BIN, 'isoscope'), *arguments], capture_output=True, text=True, timeout=240)

    @classmethod
    def output_of(cls, *arguments):
        done = cls.call(*arguments)
        if done.returncode != 0:
            raise AssertionError(f'isoscope {" ".join(arguments)}: exit code {done.returncode}\n{done.stderr}')
        return done

    def said_of(self, *arguments, output='picture.png', size=SMALL):
        """What `isoscope render` says of a picture that is right."""
        return self.output_of('render', *arguments, *VIEW, *size, '--quiet', '-o', self.path(output)).stderr

    def bytes_of(self, *arguments):
        """The PNG that `isoscope render` writes."""
        self.said_of(*arguments)
        with open(self.path('picture.png'), 'rb') as file:
            return file.read()

    def rows_of(self, *arguments, size=SMALL):
        self.said_of(*arguments, size=size)
        return read_png(self.path('picture.png'))[1]

    COLORED = ['--field', 'p', '--step', '0', '--isovalue', '0.25', '--color-by']

    # ---- colours ----

    def test_missing_values_have_a_grey_that_is_no_color_of_the_map(self):
        flat = ['--light', '0,0,1:0']  # the ambient share alone
        rows = self.rows_of(self.run_, *self.COLORED, 'holes:turbo', *flat, '--view', 'front')
        colors = {pixel for row in rows for pixel in row} - {(0, 0, 0)}
        missing = tuple(round(channel * 0.12) for channel in GREY)
        self.assertIn(missing, colors)
        seen = [x for row in rows for x, pixel in enumerate(row) if pixel == missing]
        valued = [x for row in rows for x, pixel in enumerate(row) if pixel not in (missing, (0, 0, 0))]
        self.assertGreater(len(seen), 100)
        self.assertGreater(len(valued), 100)
        self.assertLess(sum(seen) / len(seen), sum(valued) / len(valued), 'the left side lacks values')
        for x in valued:
            self.assertGreater(x, min(seen))
        teal = self.rows_of(self.run_, *self.COLORED, 'holes:turbo', *flat, '--view', 'front',
                            '--nan-color', '#ff0000')
        for row, other in zip(rows, teal):
            for pixel, changed in zip(row, other):
                self.assertEqual(changed, (31, 0, 0) if pixel == missing else pixel)

    def test_neither_agents_nor_back_ends_show(self):
        for look in (['holes'], ['holes:magma::0.2,1', '--max-layers', '3'], ['ends'],
                     ['holes', '--clip-plane', '0,0,-1,-8.25', '--caps'],
                     ['holes', '--clip-plane', '0,0,-1,-8.25', '--caps=viridis', '--light', '0,0,1']):
            one = self.bytes_of(self.path('run1'), *self.COLORED, *look)
            self.assertEqual(one, self.bytes_of(self.path('run3'), *self.COLORED, *look), look)
            self.assertEqual(one, self.bytes_of(self.path('run3'), *self.COLORED, *look, '--culling', 'none'), look)

    def test_infinite_values_show_the_ends_of_the_map_and_do_not_stretch_it(self):
        self.assertEqual(self.bytes_of(self.run_, *self.COLORED, 'ends'),
                         self.bytes_of(self.run_, *self.COLORED, 'ends:viridis:8,16'))
        flat = ['--light', '0,0,1:0', '--color-by', 'ends:grey']
        rows = self.rows_of(self.run_, *self.COLORED[:-1], *flat)
        drawn = [[pixel[0] for pixel in row if len(set(pixel)) == 1] for row in rows]
        middle = [value for value in rows[50] if value != (0, 0, 0)]
        self.assertTrue(all(len(set(pixel)) == 1 for row in rows for pixel in row), drawn)
        self.assertEqual(middle[-1], (31, 31, 31), 'the greatest end, times the ambient share')
        info = json.loads(self.output_of('info', self.run_, '--json').stdout)['datasets'][0]
        ends = next(field for field in info['fields'] if field['name'] == 'ends')['components'][0]
        self.assertEqual(ends['finite_range'], [8, 16])

    def test_a_record_makes_the_picture_again(self):
        picture = self.path('record.png')
        volume = self.path('gap.nrrd')
        look = ['--isovalue', '5', '--clip-plane', '0,0,-1,-8.25', '--caps', 'viridis', '--nan-color', 'tomato']
        self.output_of('render', volume, *look, '--renderer', 'cpu', *SMALL, '-o', picture)
        said = self.output_of('render', volume, '--renderer', 'cpu', '--like', picture, '-o', self.path('again.png'))
        self.assertIn('byte for byte', said.stdout)
        refused = self.call('render', volume, '--like', picture, '--nan-color', 'red', '-o', self.path('again.png'))
        self.assertEqual(refused.returncode, 2)
        self.assertIn('--nan-color', refused.stderr)

    def test_wrong_colors_are_refused(self):
        for flags, words in ((['--nan-color', 'reddish', '--color-by', 'holes'], "'reddish'"),
                             (['--nan-color', 'red'], '--color-by with a field, or --caps with a map'),
                             (['--nan-color', 'red', '--color-by', 'z'], '--color-by with a field')):
            done = self.call('render', self.run_, '--isovalue', '0', *flags, '-o', self.path('no.png'))
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(words, done.stderr)

    # ---- legends ----

    def swatch_of(self, *arguments, color=GREY):
        """The number of pixels that have exactly the swatch's colour, in the right half.

        Letters are white, with black around them, on blue. So no mixture of these at their edges is grey but white.
        """
        rows = self.rows_of(*arguments, '--legend', '--background', '#0000ff', size=WIDE)
        return sum(pixel == color for row in rows for pixel in row[200:])

    def test_a_legend_has_a_swatch_where_the_picture_shows_missing_values(self):
        colored = [self.run_, *self.COLORED]
        side = 11  # the least height of text
        self.assertEqual(self.swatch_of(*colored, 'holes'), side * side)
        self.assertEqual(self.swatch_of(*colored, 'holes', '--nan-color', '#00ff00', color=(0, 255, 0)), side * side)
        self.assertEqual(self.swatch_of(*colored, 'holes:grey', color=(128, 0, 128)), side * side)
        # From the right no missing value is seen; cut away it is none.
        self.assertEqual(self.swatch_of(*colored, 'holes', '--azimuth', '90'), 0)
        self.assertEqual(self.swatch_of(*colored, 'holes', '--clip-plane', '1,0,0,9.5'), 0)
        self.assertEqual(self.swatch_of(*colored, 'ends'), 0)
        self.assertEqual(self.swatch_of(*colored, 'z'), 0)

    def test_caps_that_show_samples_have_a_legend(self):
        cut = [self.run_, '--field', 'p', '--step', '0', '--isovalue', '0.25', '--clip-plane', '0,0,-1,-8.25']
        yellow, red = (253, 231, 37), (122, 4, 3)  # the greatest ends of viridis and turbo
        for flags, expected in ((['--caps=viridis'], [yellow]), (['--caps=viridis', '--color-by', 'z:turbo'], [yellow, red]),
                                (['--caps', '--color-by', 'z:turbo'], [red]), (['--caps=turbo', '--color-by', 'normal'], [red])):
            rows = self.rows_of(*cut, *flags, '--legend', size=WIDE)
            columns = [{x for row in rows for x, pixel in enumerate(row) if pixel == color} for color in expected]
            for of_color in columns:
                self.assertTrue(of_color and max(of_color) > 250, flags)
        refused = self.call('render', *cut, '--caps', '--legend', '-o', self.path('no.png'))
        self.assertEqual(refused.returncode, 2)
        self.assertIn('--caps MAP', refused.stderr)

    def test_a_value_of_caps_has_one_color_in_all_steps(self):
        # Samples are 7 minus a distance; those of step 1 are 3 more.
        least = 7 - max(math.dist((x, y, z), CENTER) for x in (0, 23) for y in (0, 19) for z in (0, 17))
        most = 7 - min(math.dist((x, y, z), CENTER) for x in (11, 12) for y in (9, 10) for z in (8, 9)) + 3
        as_float = [struct.unpack('<f', struct.pack('<f', value))[0] for value in (least, most)]
        for step in ('0', '1'):
            cut = [self.run_, '--field', 'p', '--step', step, '--isovalue', '0.25', '--clip-plane', '0,0,-1,-8.25']
            self.assertEqual(self.bytes_of(*cut, '--caps=viridis', '--color-range', 'all'),
                             self.bytes_of(*cut, f'--caps=viridis:{as_float[0]!r},{as_float[1]!r}'))

    # ---- ranges ----

    def test_the_range_of_a_step_is_that_of_its_samples(self):
        least = 7 - max(math.dist((x, y, z), CENTER) for x in (0, 23) for y in (0, 19) for z in (0, 17))
        most = 7 - min(math.dist((x, y, z), CENTER) for x in (11, 12) for y in (9, 10) for z in (8, 9))
        for step in (0, 1):
            cut = [self.run_, '--field', 'p', '--step', str(step), '--isovalue', '0.25', '--clip-plane', '0,0,-1,-8.25']
            ends = [struct.unpack('<f', struct.pack('<f', value + 3 * step))[0] for value in (least, most)]
            self.assertEqual(self.bytes_of(*cut, '--caps=viridis', '--color-range', 'step'),
                             self.bytes_of(*cut, f'--caps=viridis:{ends[0]!r},{ends[1]!r}'), step)

    def test_ranges_of_pictures_do_not_show_how_the_volume_is_cut(self):
        cut = ['--clip-plane', '0,0,-1,-8.25', '--caps=viridis']
        looks = (['holes', *cut], ['holes', *cut, '--cap-window', '10,90'], ['holes', *cut, '--color-range', 'visible'],
                 ['ends', '--color-range', 'visible'], ['z', '--color-range', 'visible'],
                 ['holes:magma::0.2,1', '--color-range', 'visible'], ['gradient', '--color-range', 'step'])
        pictures = [self.bytes_of(self.path('run1'), *self.COLORED, *look) for look in looks]
        for look, picture in zip(looks, pictures):
            self.assertEqual(picture, self.bytes_of(self.path('run3'), *self.COLORED, *look), look)
            self.assertEqual(picture, self.bytes_of(self.path('run3'), *self.COLORED, *look, '--threads', '1'), look)
        self.assertEqual(len(set(pictures)), len(pictures))
        refused = self.call('render', self.run_, *self.COLORED, 'z', '--color-range', 'visible', '--region', '0,0,8,8',
                            '-o', self.path('no.png'))
        self.assertEqual(refused.returncode, 1)
        self.assertIn('region is set beside a range', refused.stderr)

    # ---- surfaces that do not show ----

    def test_a_picture_that_shows_all_says_nothing(self):
        self.assertEqual(self.said_of(self.run_, *self.COLORED, 'holes'), '')
        self.assertEqual(self.said_of(self.path('labels.nrrd'), '--labels', 'all'), '')
        # The inner surface is hidden by the outer one, as it is meant.
        self.assertEqual(self.said_of(self.run_, '--field', 'p', '--step', '0', '--surface', '0.25', '--surface', '3'), '')

    def test_each_way_to_draw_nothing_is_told(self):
        run, labels = [self.run_, '--field', 'p', '--step', '0'], self.path('labels.nrrd')
        for arguments, words in (
                ([*run, '--isovalue', '50'], 'isovalue 50 has no surface: the values of the volume at step 0 are in [-'),
                ([*run, '--surface', '0.25', '--surface', '50'], 'isovalue 50 has no surface: '),
                ([self.path('gap.nrrd'), '--isovalue', '5'],
                 'isovalue 5 has no surface: the values of the volume are in [0, 10], but no cell has samples on both'),
                ([self.path('nan.nrrd'), '--isovalue', '5'], 'isovalue 5 has no surface: every sample of the volume is NaN'),
                ([labels, '--label', '5'], 'label 5 has no surface: no sample has it; the samples are 0, 3, 7'),
                ([labels, '--label', '3', '--label', '99'], 'label 99 has no surface: '),
                ([labels, '--label', '3,5,7'], 'no sample has label 5 of 3, 5, 7; the samples are 0, 3, 7'),
                ([labels, '--label', '0,3,7'], 'labels 0, 3, 7 have no surface: no cell has a sample inside and one outside'),
                ([*run, '--isovalue', '0.25', '--clip-box', '0,2,0,2,0,2'], 'isovalue 0.25 does not show: the clip region cuts'),
                ([*run, '--isovalue', '0.25', '--eye', '0,0,100', '--target', '0,0,200', '--up', '0,1,0'],
                 'isovalue 0.25 does not show: it lies outside of the picture'),
                ([*run, '--isovalue', '0.25', '--region', '0,0,5,5'], 'isovalue 0.25 does not show: it lies outside'),
                ([*run, '--isovalue', '0.25', '--color-by', 'z:grey::0,0'],
                 'isovalue 0.25 does not show: the opacity of its colours, 0 to 0, is 0'),
                ([*run, '--isovalue', '0.25', '--color-by', 'z:grey:100,200:0,1'], 'isovalue 0.25 does not show: the opacity')):
            said = self.said_of(*arguments)
            self.assertIn(f'isoscope: {words}', said, arguments)
            self.assertEqual(said.count('\n'), 1, said)

    def test_films_name_the_frames_without_a_surface(self):
        said = self.said_of(self.run_, '--field', 'p', '--isovalue', '8', '--step', 'first:last', output='steps.apng')
        self.assertIn('isoscope: frame 0: isovalue 8 has no surface: the values of the volume at step 0 are in [', said)
        said = self.said_of(self.run_, '--field', 'p', '--step', '0', '--isovalue', '5:9:1', output='sweep%d.png')
        self.assertIn('isoscope: frame 2: isovalue 7 has no surface: ', said)
        self.assertIn('isoscope: frame 4: isovalue 9 has no surface: ', said)
        self.assertEqual(said.count('\n'), 3)
        self.assertEqual(self.said_of(self.run_, '--field', 'p', '--isovalue', '50', '--step', '0', '--repeat', '3',
                                      '--orbit', '30').count('isovalue 50'), 1)

    def test_statistics_have_the_notes(self):
        done = self.output_of('render', self.path('labels.nrrd'), '--label', '5', *VIEW, '--stats', '-', '-o',
                              self.path('picture.png'))
        note, = json.loads(done.stdout)['frames'][0]['notes']
        self.assertEqual((note['surface_index'], note['reason']), (0, 'no_label'))
        self.assertIn('no sample has it', note['message'])

    def test_a_poster_tells_once(self):
        done = self.output_of('render', self.run_, '--field', 'p', '--step', '0', '--isovalue', '50', '--renderer', 'cpu',
                              '--width', '16400', '--height', '40', '--quiet', '-o', self.path('poster.png'))
        self.assertEqual(done.stderr.count('isovalue 50 has no surface'), 1, done.stderr)

    def test_meshes_and_picks_of_nothing_are_right_and_say_why(self):
        labels = self.path('labels.nrrd')
        for arguments, words in (([labels, '--label', '5'], 'label 5 has no surface'),
                                 ([labels, '--label', '3,5'], 'no sample has label 5 of 3, 5'),
                                 ([labels, '--label', '3', '--clip-box', '0,2,0,2,0,2'], 'the clip region cuts all of it away'),
                                 ([labels, '--isovalue', '300'], 'isovalue 300 has no surface')):
            done = self.output_of('export', *arguments, '-o', self.path('mesh.ply'))
            self.assertIn(f'isoscope: ', done.stderr)
            self.assertIn(words, done.stderr)
        self.assertEqual(self.output_of('export', labels, '--labels', 'all', '-o', self.path('mesh.ply')).stderr, '')
        done = self.output_of('pick', labels, '--label', '5', '--pixel', '3,4')
        self.assertIn('label 5 has no surface: no sample has it', done.stderr)
        self.assertEqual(self.output_of('pick', labels, '--label', '3', '--pixel', '500,512').stderr, '')


if __name__ == '__main__':
    unittest.main()
