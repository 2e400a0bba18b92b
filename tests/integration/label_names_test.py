#!/usr/bin/env python3
"""Names of labels, from a file to what people see: info, render, export, pick.

    label_names_test.py BIN_FOLDER [unittest arguments]

Two boxes touch each other in a segmentation as 3D Slicer writes it; a second one has the names in a file of its own.
"""

import json
import os
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from png_rows import read_png  # noqa: E402

BIN = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 else '.')
SIDE = 24
SEGMENTS = '''Segment0_Color:=1 0 0
Segment0_LabelValue:=1
Segment0_Layer:=0
Segment0_Name:=left box
Segment1_Color:=0 0 1
Segment1_LabelValue:=2
Segment1_Layer:=0
Segment1_Name:=right box
'''


def samples():
    """[z][y][x]: 1 in the left half of a box, 2 in its right half, 0 around it."""
    return bytes(
        (1 if x < SIDE // 2 else 2) if all(6 <= c < SIDE - 6 for c in (y, z)) and 4 <= x < SIDE - 4 else 0
        for z in range(SIDE) for y in range(SIDE) for x in range(SIDE))


def nrrd(more=''):
    header = (f'NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {SIDE} {SIDE} {SIDE}\n'
              'space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nkinds: domain domain domain\n'
              f'encoding: raw\n{more}\n')
    return header.encode() + samples()


class LabelNamesTest(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        os.environ['XDG_CACHE_HOME'] = os.path.join(cls.folder.name, 'cache')
        cls.seg = cls.path('boxes.seg.nrrd')
        cls.plain = cls.path('plain.nrrd')
        cls.names = cls.path('names.csv')
        with open(cls.seg, 'wb') as file:
            file.write(nrrd(SEGMENTS))
        with open(cls.plain, 'wb') as file:
            file.write(nrrd())
        with open(cls.names, 'w') as file:
            file.write('value,name,color\n1,left box,#ff0000\n2,right box,#0000ff\n')

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder.name, name)

    def call(self, *arguments):
        return subprocess.run([os.path.join(BIN, 'isoscope'), *arguments], capture_output=True, text=True)

    def output_of(self, *arguments):
        done = self.call(*arguments)
        self.assertEqual(done.returncode, 0, f'{arguments}: {done.stderr}')
        return done.stdout

    def picture(self, name, source, *flags):
        path = self.path(name)
        self.output_of('render', source, '--view', 'front', '--width', '96', '--height', '96', *flags, '-o', path)
        return path

    def test_info_lists_the_labels_of_a_file_and_of_its_dataset(self):
        text = self.output_of('info', self.seg)
        self.assertIn('1  #ff0000  left box', text)
        directory = self.path('boxes')
        self.output_of('partition', self.seg, '--output', directory, '--shards', '2')
        self.assertIn('2  #0000ff  right box', self.output_of('info', directory))
        labels = json.loads(self.output_of('info', directory, '--json'))['datasets'][0]['labels']
        self.assertEqual(labels, [{'value': 1, 'name': 'left box', 'color': '#ff0000'},
                                  {'value': 2, 'name': 'right box', 'color': '#0000ff'}])
        self.assertNotIn('labels', json.loads(self.output_of('info', self.plain, '--json'))['volume'])
        with_names = json.loads(self.output_of('info', self.plain, '--label-names', self.names, '--json'))
        self.assertEqual(with_names['volume']['labels'], labels)

    def test_each_label_has_its_colour_and_both_are_one_surface_in_a_set(self):
        _, rows = read_png(self.picture('all.png', self.seg, '--labels', 'all'))
        left, right = rows[48][30], rows[48][66]
        self.assertGreater(left[0], 2 * left[2], left)
        self.assertGreater(right[2], 2 * right[0], right)
        _, rows = read_png(self.picture('set.png', self.seg, '--label', '2,left box'))
        for pixel in (rows[48][30], rows[48][66]):
            self.assertGreater(pixel[0], 2 * pixel[2], pixel)  # of the first label
        _, rows = read_png(self.picture('green.png', self.seg, '--label', 'RIGHT box:#00ff00'))
        self.assertEqual(rows[48][30], (0, 0, 0))
        self.assertGreater(rows[48][66][1], 100)

    def test_names_of_a_file_of_their_own_make_the_same_picture(self):
        ours = self.picture('names.png', self.plain, '--label-names', self.names, '--labels', 'all', '--no-metadata')
        theirs = self.picture('theirs.png', self.seg, '--labels', 'all', '--no-metadata')
        self.assertEqual(open(ours, 'rb').read(), open(theirs, 'rb').read())
        without = self.picture('without.png', self.plain, '--labels', 'all', '--no-metadata')
        self.assertNotEqual(open(without, 'rb').read(), open(ours, 'rb').read())

    def test_a_picture_of_labels_is_made_again_from_its_record(self):
        picture = self.picture('record.png', self.seg, '--label', '1', '--label', '2::0.5')
        self.output_of('render', self.seg, '--like', picture, '-o', self.path('again.png'))
        self.assertEqual(read_png(picture), read_png(self.path('again.png')))

    def test_smooth_labels_differ_and_are_made_again_from_their_record(self):
        smooth = self.picture('smooth.png', self.seg, '--labels', 'all', '--smooth-labels')
        rough = self.picture('rough.png', self.seg, '--labels', 'all')
        self.assertNotEqual(read_png(smooth), read_png(rough))
        self.output_of('render', self.seg, '--like', smooth, '-o', self.path('again.png'))
        self.assertEqual(read_png(smooth), read_png(self.path('again.png')))
        done = self.call('export', self.seg, '--labels', 'all', '--smooth-labels', '--clip-plane', '1,0,0,12', '-o', self.path('no.obj'))
        self.assertEqual(done.returncode, 1)
        self.assertIn("a smooth mesh can't be cut", done.stderr)
        done = self.call('render', self.seg, '--isovalue', '1', '--smooth-labels', '-o', self.path('no.png'))
        self.assertEqual(done.returncode, 2)
        self.assertIn('--smooth-labels', done.stderr)

    def test_a_segmentation_opens_as_labels_with_names_or_without(self):
        ball = self.path('suggested.nrrd')
        self.output_of('generate', 'labels', '--regions', '9', '--dims', '48,48,48', '-o', ball)
        histogram = json.loads(self.output_of('info', ball, '--histogram', '--json'))['histogram']
        self.assertEqual(histogram['suggested_labels'], list(range(1, 10)))
        self.assertIn('--labels all', self.output_of('info', ball, '--histogram'))
        with open(ball, 'rb') as file:
            header, samples = file.read().split(b'\n\n', 1)
        bare = self.path('bare.nrrd')
        with open(bare, 'wb') as file:
            file.write(b'\n'.join(line for line in header.split(b'\n') if not line.startswith(b'Segment')) + b'\n\n' + samples)
        for path in (ball, bare):
            commands = json.loads(self.output_of('info', path, '--json'))['volume']['commands']
            self.assertEqual(len(commands), 1)
            self.assertTrue(commands[0].endswith(' --labels all'), commands)
        histogram = json.loads(self.output_of('info', bare, '--histogram', '--json'))['histogram']
        self.assertEqual(histogram['suggested_labels'], list(range(1, 10)))
        field = self.path('field.nrrd')
        self.output_of('generate', 'gyroid', '--dims', '48,48,48', '--type', 'uint8', '-o', field)
        self.assertIn(' --isovalue ', json.loads(self.output_of('info', field, '--json'))['volume']['commands'][0])
        histogram = json.loads(self.output_of('info', field, '--histogram', '--json'))['histogram']
        self.assertEqual(histogram['suggested_labels'], [])

    def test_labels_and_an_isovalue_go_together(self):
        _, rows = read_png(self.picture('both.png', self.seg, '--isovalue', '1.5', '--color', '#00ff00', '--label', '1'))
        self.assertGreater(rows[48][30][0], 2 * rows[48][30][2])
        self.assertGreater(rows[48][66][1], 100)

    def test_a_pick_tells_the_label(self):
        text = self.output_of('pick', self.seg, '--labels', 'all', '--width', '96', '--height', '96', '--json',
                              '--pixel', '30,48', '--pixel', '66,48', '--pixel', '1,1')
        points = json.loads(text)['points']
        self.assertEqual([(point.get('label'), point.get('label_name')) for point in points],
                         [(1, 'left box'), (2, 'right box'), (None, None)])

    def test_meshes_have_the_names(self):
        path = self.path('boxes.obj')
        self.output_of('export', self.seg, '--labels', 'all', '-o', path)
        objects = [line.strip() for line in open(path) if line.startswith('o ')]
        self.assertEqual(objects, ['o surface_0_left_box', 'o surface_1_right_box'])

    def test_a_generated_segmentation_shows_all_its_labels_in_their_colours(self):
        ball = self.path('ball.nrrd')
        self.assertIn('labels 1 to 9', self.output_of('generate', 'labels', '--regions', '9', '--dims', '48,48,48', '-o', ball))
        labels = json.loads(self.output_of('info', ball, '--json'))['volume']['labels']
        self.assertEqual([label['name'] for label in labels], ['core'] + [f'cell {i}' for i in range(2, 10)])
        # Each cell reaches the rim, so one of six views shows it; the core shows where the others are left out.
        seen = {}
        for view in ('front', 'back', 'left', 'right', 'top', 'bottom'):
            text = self.output_of('pick', ball, '--labels', 'all', '--width', '64', '--height', '64', '--view', view, '--json',
                                  *[word for x in range(0, 64, 4) for y in range(0, 64, 4) for word in ('--pixel', f'{x},{y}')])
            seen.update((point['label'], point['label_name']) for point in json.loads(text)['points'] if 'label' in point)
        self.assertEqual(seen, {label['value']: label['name'] for label in labels[1:]})
        _, rows = read_png(self.picture('core.png', ball, '--label', 'core', '--light', '0,0,1'))
        self.assertGreater(min(rows[48][48]), 200)
        # Together they hide the core, and leave no gap to the black behind them.
        _, rows = read_png(self.picture('ball.png', ball, '--labels', 'all'))
        self.assertNotIn((0, 0, 0), [rows[y][x] for y in range(40, 57) for x in range(40, 57)])
        done = self.call('generate', 'gyroid', '--regions', '9', '--dims', '8,8,8', '-o', self.path('no.nrrd'))
        self.assertIn('--regions has no meaning for the field gyroid', done.stderr)

    def test_wrong_labels_are_answered_with_what_to_do(self):
        for flags, words in ((('--label', 'left bxo'), "did you mean 'left box'?"),
                             (('--label', '3:redd'), 'SET:COLOR'),
                             (('--labels', '1,2'), '--label 1,2'),
                             (('--labels', 'all', '--label', '1'), 'leave --label out'),
                             (('--label', '1', '--color', 'red'), '--label SET:COLOR')):
            done = self.call('render', self.seg, *flags, '-o', self.path('no.png'))
            self.assertNotEqual(done.returncode, 0, flags)
            self.assertIn(words, done.stderr)
        with open(self.path('wrong.csv'), 'w') as file:
            file.write('1,a\nliver\n')
        done = self.call('render', self.plain, '--label-names', self.path('wrong.csv'), '--labels', 'all', '-o', 'n.png')
        self.assertIn('wrong.csv: line 2: "liver"', done.stderr)

    def test_flags_of_a_volume_are_refused_for_a_dataset_folder(self):
        directory = self.path('made')
        self.output_of('partition', self.seg, '--output', directory, '--shards', '1')
        for command in (('info', directory), ('render', directory, '--isovalue', '1', '-o', self.path('no.png'))):
            for flags, has in ((('--label-names', self.names), 'names'), (('--stride', '2'), 'samples')):
                done = self.call(*command, *flags)
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertIn(f"{flags[0]} is for a volume; '{directory}' is a dataset, which has the {has} it was made with: "
                              'partition the volume anew with this flag', done.stderr)

    def test_a_label_that_no_sample_has_is_told(self):
        done = self.call('render', self.seg, '--label', '9', '--width', '8', '--height', '8', '-o', self.path('9.png'))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn('label 9 has no surface', done.stderr)

    def test_a_damaged_table_is_told_and_the_volume_is_read(self):
        path = self.path('damaged.nrrd')
        with open(path, 'wb') as file:
            file.write(nrrd('Segment0_LabelValue:=one\n'))
        done = self.call('info', path)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn('the names of labels are not used', done.stderr)


if __name__ == '__main__':
    unittest.main()
