#!/usr/bin/env python3
"""Files that h5py writes, as beamlines, MATLAB and biologists do: filters, names, NeXus, locks.

    hdf5_kinds_test.py ISOSCOPE [unittest arguments]
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
import skips

try:
  import h5py
  import numpy as np
except ImportError:
  h5py = None

ISOSCOPE = os.path.abspath(sys.argv.pop(1))

# By the name that messages have. The first two need no plugin.
FILTERS = {
    'gzip': dict(compression='gzip', shuffle=True),
    'szip': dict(compression='szip'),
    'bzip2': dict(compression=307, compression_opts=(9,)),
    'LZF': dict(compression='lzf'),
    'Blosc': dict(compression=32001, compression_opts=(0, 0, 0, 0, 5, 1, 0)),
    'LZ4': dict(compression=32004),
    'ZFP': dict(compression=32013, compression_opts=(5, 0, 0, 0)),  # reversible
}


def environment(**more):
  kept = {name: value for name, value in os.environ.items() if not name.startswith('HDF5_')}
  return {**kept, **more}


@skips.skip_unless(h5py is not None, 'h5py', 'python3-h5py is not installed')
class Hdf5KindsTest(unittest.TestCase):

  def setUp(self):
    own = tempfile.TemporaryDirectory(prefix='isoscope-hdf5-test-')
    self.addCleanup(own.cleanup)
    self.folder = own.name
    z, y, x = np.mgrid[0:20, 0:22, 0:24]
    self.samples = (x + 30 * y + 900 * z).astype('float32')

  def path(self, name):
    return os.path.join(self.folder, name)

  def info(self, name, **more):
    """The description of a volume, or the error."""
    done = subprocess.run([ISOSCOPE, 'info', self.path(name), '--json', '--values'], capture_output=True, text=True,
                          env=environment(**more), timeout=60)
    return json.loads(done.stdout)['volume'] if done.returncode == 0 else done.stderr

  def write_with_missing_filter(self, name):
    with h5py.File(self.path(name), 'w') as file:
      space = h5py.h5s.create_simple(self.samples.shape)
      properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
      properties.set_chunk(self.samples.shape)
      properties.set_filter(31999, h5py.h5z.FLAG_OPTIONAL, ())
      h5py.h5d.create(file.id, b'v', h5py.h5t.IEEE_F32LE, space, properties)

  def test_filters_of_debian_are_read_or_named_with_their_package(self):
    missing = []
    for name, options in FILTERS.items():
      with self.subTest(filter=name):
        try:
          with h5py.File(self.path('f.h5'), 'w') as file:
            file.create_dataset('v', data=self.samples, chunks=(10, 22, 24), **options)
        except (ValueError, OSError):  # h5py loads plugins, too
          missing.append(name)
          continue
        found = self.info('f.h5')
        if name == 'LZF' and isinstance(found, str):  # h5py has its own one
          self.assertIn("filter 32000 (LZF), which is not installed: install Debian's package hdf5-plugin-lzf", found)
          missing.append(name)
          continue
        self.assertEqual(found['value_range'], [0, float(self.samples.max())], found)
    if missing:
      skips.skip('hdf5-filters', f'not installed: {missing}')

  @skips.skip_unless(shutil.which('cc') is not None, 'compiler', 'no C compiler')
  def test_plugins_are_loaded_from_no_folder_but_those_named_for_isoscope(self):
    self.write_with_missing_filter('f.h5')
    mark = self.path('loaded')
    source = ('#include <stdio.h>\n__attribute__((constructor)) static void Load(void) '
              f'{{ fclose(fopen("{mark}", "w")); }}\n')
    subprocess.run(['cc', '-shared', '-fPIC', '-x', 'c', '-', '-o', self.path('libplugin.so')], input=source, text=True,
                   check=True)
    self.assertIn('filter 31999, which is not installed', self.info('f.h5', HDF5_PLUGIN_PATH=self.folder))
    self.assertFalse(os.path.exists(mark))
    self.assertIn('filter 31999', self.info('f.h5', ISOSCOPE_HDF5_PLUGIN_PATH=self.folder))
    self.assertTrue(os.path.exists(mark))

  def test_any_name_will_do(self):
    for name in ('scan.nxs', 'cells.h5ad', 'x.cxi', 'y.nx5', 'plain', 'z.loom'):
      with h5py.File(self.path(name), 'w') as file:
        file['entry/data'] = self.samples
        file['entry/mask'] = self.samples > 5
      found = self.info(f'{name}:/entry/data')
      self.assertEqual(found['sample_dims'], [24, 22, 20], found)
      self.assertEqual(self.info(f'{name}:/entry/mask')['value_range'], [0, 1])

  def test_matlab_arrays_have_their_first_index_as_x(self):
    with h5py.File(self.path('v.mat'), 'w', userblock_size=512) as file:
      file['V'] = self.samples  # size(V) is [24 22 20] in MATLAB
      file['V'].attrs['MATLAB_class'] = np.bytes_('single')
      file['title'] = np.zeros((5, 4, 3), 'uint16')
      file['title'].attrs['MATLAB_class'] = np.bytes_('char')
    with open(self.path('v.mat'), 'r+b') as file:
      file.write(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\0\2IM')
    found = self.info('v.mat')
    self.assertEqual(found['sample_dims'], [24, 22, 20], found)
    self.assertEqual(found['fields'][0]['name'], 'V')

  def test_default_plot_of_nexus_has_its_positions(self):
    with h5py.File(self.path('scan.nxs'), 'w') as file:
      file.attrs['default'] = 'entry'
      entry = file.create_group('entry')
      entry.attrs.update(NX_class='NXentry', default='plot')
      plot = entry.create_group('plot')
      plot.attrs.update(NX_class='NXdata', signal='counts', axes=['z', 'y', 'x'])
      plot['counts'] = self.samples.astype('int64')
      plot['errors'] = self.samples
      for axis, first, step, size in (('z', 5, 0.5, 20), ('y', 0, -1, 22), ('x', -3, 2, 24)):
        plot[axis] = first + step * np.arange(size)
        plot[axis].attrs['units'] = 'mm'
    found = self.info('scan.nxs')
    self.assertEqual(found['fields'][0]['name'], 'counts', found)
    self.assertEqual(found['spacing'], [2, 1, 0.5])
    self.assertEqual(found['origin'], [-3, 0, 5])
    self.assertEqual(found['length_unit'], 'mm')

  def test_file_that_is_being_written_says_so_and_its_advice_works(self):
    for version in ('earliest', 'latest'):
      with self.subTest(version=version):
        name = f'{version}.h5'
        with h5py.File(self.path(name), 'w', libver=version) as file:
          file['v'] = self.samples
          file.flush()
          found = self.info(name)
          self.assertIn('locked by a program that writes it', found)
          self.assertIn('h5clear --status COPY', found)
          shutil.copyfile(self.path(name), self.path('copy.h5'))
        if version == 'latest':
          self.assertIn('marked as open for writing', self.info('copy.h5'))
          if not shutil.which('h5clear'):
            continue
          subprocess.run(['h5clear', '--status', self.path('copy.h5')], check=True)
        self.assertEqual(self.info('copy.h5')['sample_dims'], [24, 22, 20])
        self.assertEqual(self.info(name)['sample_dims'], [24, 22, 20])


if __name__ == '__main__':
  unittest.main()
