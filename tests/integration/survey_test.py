#!/usr/bin/env python3
"""scripts/survey.py tells what opens, what is refused and what is no volume.

    survey_test.py SURVEY ISOSCOPE [unittest arguments]
"""

import json
import os
import stat
import subprocess
import sys
import tempfile
import unittest

ISOSCOPE = os.path.abspath(sys.argv.pop(2))
SURVEY = os.path.abspath(sys.argv.pop(1))


class SurveyTest(unittest.TestCase):

  def setUp(self):
    own = tempfile.TemporaryDirectory(prefix='isoscope-survey-test-')
    self.addCleanup(own.cleanup)
    self.tree = os.path.join(own.name, 'tree')
    os.mkdir(self.tree)
    self.report = os.path.join(own.name, 'report.json')

  def write(self, name, data):
    with open(os.path.join(self.tree, name), 'wb') as file:
      file.write(data)

  def survey(self, program=ISOSCOPE):
    done = subprocess.run([sys.executable, SURVEY, self.tree, '--bin', program, '--json', self.report, '--timeout', '60'],
                          capture_output=True, text=True, timeout=300)
    with open(self.report, encoding='utf-8') as file:
      return done, {os.path.basename(r['path']): r for r in json.load(file)}

  def test_volumes_are_drawn_damaged_ones_refused_and_others_left_out(self):
    whole = os.path.join(self.tree, 'whole.nrrd')
    subprocess.run([ISOSCOPE, 'generate', 'random', '--dims', '16,16,16', '--output', whole], check=True,
                   capture_output=True)
    flow = os.path.join(self.tree, 'flow.pvd')
    subprocess.run([ISOSCOPE, 'generate', 'flow', '--dims', '10,9,8', '--steps', '2', '--output', flow], check=True,
                   capture_output=True)
    with open(whole, 'rb') as file:
      self.write('cut.nrrd', file.read()[:-100])
    self.write('letter.txt', b'no volume\n')
    done, found = self.survey()
    self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
    self.assertEqual({name: r['outcome'] for name, r in found.items()},
                     {'whole.nrrd': 'opened', 'cut.nrrd': 'refused', 'letter.txt': 'no file of volumes',
                      'flow.pvd': 'opened', 'flow_00000.vti': 'opened', 'flow_00001.vti': 'opened'},
                     done.stdout)
    self.assertEqual(found['whole.nrrd']['step'], 'render')
    self.assertIn('cut.nrrd', found['cut.nrrd']['message'])

  def test_a_zarr_store_and_each_of_its_arrays_is_a_source(self):
    store = os.path.join(self.tree, 'run.zarr')
    array = {'zarr_format': 2, 'shape': [4, 4, 4], 'chunks': [4, 4, 4], 'dtype': '|u1', 'order': 'C', 'compressor': None,
             'fill_value': 0, 'filters': None}
    for name, metadata, chunk in (('volume', array, '0.0.0'), ('plane', dict(array, shape=[4, 4], chunks=[4, 4]), '0.0')):
      os.makedirs(os.path.join(store, name))
      with open(os.path.join(store, name, '.zarray'), 'w', encoding='utf-8') as file:
        json.dump(metadata, file)
      with open(os.path.join(store, name, chunk), 'wb') as file:
        file.write(bytes(range(4 ** len(metadata['shape']))))
    with open(os.path.join(store, '.zgroup'), 'w', encoding='utf-8') as file:
      json.dump({'zarr_format': 2}, file)
    done, found = self.survey()
    self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
    self.assertEqual({name: (r['ending'], r['outcome']) for name, r in found.items()},
                     {'run.zarr': ('Zarr', 'opened'), 'volume': ('Zarr array', 'opened'),
                      'plane': ('Zarr array', 'refused')}, done.stdout)
    self.assertIn('an array of 2 axes', found['plane']['message'])

  def test_a_program_that_crashes_fails_the_survey(self):
    self.write('a.nrrd', b'NRRD0004\n')
    program = os.path.join(os.path.dirname(self.report), 'crashes')
    with open(program, 'w', encoding='utf-8') as file:
      file.write('#!/bin/sh\nkill -SEGV $$\n')
    os.chmod(program, stat.S_IRWXU)
    done, found = self.survey(program)
    self.assertEqual(found['a.nrrd']['outcome'], 'crashed')
    self.assertEqual(done.returncode, 1)


if __name__ == '__main__':
  unittest.main()
