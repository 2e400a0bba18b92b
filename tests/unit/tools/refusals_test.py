#!/usr/bin/env python3
"""docs/remote.md tells what each refusal says: the sentences are in the sources, and the codes exist.

    refusals_test.py SOURCE_TREE [unittest arguments]
"""

import glob
import os
import re
import sys
import unittest

SOURCES = os.path.abspath(sys.argv.pop(1)) if len(sys.argv) > 1 else '.'
HEADING = '## What each refusal says'
CODES = {
    'INVALID_ARGUMENT', 'NOT_FOUND', 'ALREADY_EXISTS', 'PERMISSION_DENIED', 'UNAUTHENTICATED', 'RESOURCE_EXHAUSTED',
    'FAILED_PRECONDITION', 'UNAVAILABLE', 'DATA_LOSS', 'exit code 2'
}


def literals(text):
    """The string literals of a source; those beside each other are one."""
    one = r'"((?:[^"\\\n]|\\.)*)"'
    for match in re.finditer(one + r'(?:\s*' + one + ')*', text):
        yield ''.join(re.findall(one, match[0])).replace('\\"', '"').replace('\\n', '\n')


def rows(document):
    """The cells of each row of the table below the heading."""
    section = document.split(HEADING + '\n', 1)[1].split('\n## ', 1)[0]
    table = [line for line in section.split('\n') if line.startswith('|')]
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in table[2:]]


def fragments(cell):
    """The words of each sentence between its values, which are dots."""
    for sentence in re.findall(r'`([^`]*)`', cell):
        for fragment in sentence.split('...'):
            if fragment.strip():
                yield fragment.strip()


class RefusalsTest(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        with open(os.path.join(SOURCES, 'docs', 'remote.md'), encoding='utf-8') as file:
            cls.rows = rows(file.read())
        cls.said = []
        for folder in ('core', 'client-cli', 'partition-agent'):
            for path in glob.glob(os.path.join(SOURCES, folder, '**', '*.cc'), recursive=True):
                with open(path, encoding='utf-8') as file:
                    cls.said += literals(file.read())

    def test_sentences_are_in_the_sources(self):
        self.assertGreater(len(self.rows), 20, 'the table is not found')
        missing = [
            fragment for row in self.rows for fragment in fragments(row[2])
            if not any(fragment in literal for literal in self.said)
        ]
        self.assertEqual(missing, [], 'no program says so')

    def test_rows_are_whole(self):
        for row in self.rows:
            self.assertEqual(len(row), 4, row)
            self.assertTrue(set(re.split(', | or ', row[1].replace('`', ''))) <= CODES, row)
            self.assertTrue(list(fragments(row[2])), row)

    def test_literals_beside_each_other_are_one(self):
        self.assertEqual(list(literals('f("a b "\n  "c \\"d\\"", x, "e")')), ['a b c "d"', 'e'])
        self.assertEqual(list(fragments('`has ... bytes`, `or none`')), ['has', 'bytes', 'or none'])


if __name__ == '__main__':
    unittest.main()
