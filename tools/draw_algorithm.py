#!/usr/bin/env python3
"""Draws the figures of docs/algorithm.md.

    tools/draw_algorithm.py            writes docs/algorithm/*.svg
    tools/draw_algorithm.py --check    exit code 1 if a file there is not what this script draws
"""
import math
import pathlib
import sys

FOLDER = pathlib.Path(__file__).resolve().parent.parent / 'docs' / 'algorithm'
INK, GREY = '#222', '#888'
BLUE, ORANGE, GREEN, RED = '#2b6cb0', '#c05621', '#2f855a', '#c53030'


class Figure:
    """An SVG of a given width and height, on white, with y downwards."""

    def __init__(self, width, height, title):
        self.lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
            'font-family="Helvetica, Arial, sans-serif" font-size="13">',
            f'<title>{title}</title>',
            f'<rect width="{width}" height="{height}" fill="#fff"/>',
        ]

    def rect(self, x, y, width, height, fill='none', stroke=INK, dash='', thickness=1.5):
        dash = f' stroke-dasharray="{dash}"' if dash else ''
        self.lines.append(f'<rect x="{x}" y="{y}" width="{width}" height="{height}" fill="{fill}" stroke="{stroke}" '
                          f'stroke-width="{thickness}"{dash}/>')

    def line(self, x1, y1, x2, y2, stroke=INK, dash='', thickness=1.5):
        dash = f' stroke-dasharray="{dash}"' if dash else ''
        self.lines.append(f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="{stroke}" '
                          f'stroke-width="{thickness}"{dash}/>')

    def arrow(self, x1, y1, x2, y2, stroke=INK):
        """A horizontal arrow."""
        self.line(x1, y1, x2, y2, stroke)
        back = -7 if x2 > x1 else 7
        self.lines.append(f'<path d="M{x2} {y2} l{back} -4 v8 z" fill="{stroke}"/>')

    def dot(self, x, y, fill, radius=4):
        self.lines.append(f'<circle cx="{x}" cy="{y}" r="{radius}" fill="{fill}"/>')

    def path(self, d, stroke=INK, thickness=2.5):
        self.lines.append(f'<path d="{d}" fill="none" stroke="{stroke}" stroke-width="{thickness}"/>')

    def text(self, x, y, text, fill=INK, anchor='start', size=13):
        self.lines.append(f'<text x="{x}" y="{y}" fill="{fill}" text-anchor="{anchor}" font-size="{size}">{text}</text>')

    def svg(self):
        return '\n'.join(self.lines + ['</svg>', ''])


def block():
    """Samples in rows: those of one block of 4 x 4 cells, the layer that it shares, its ghosts."""
    figure = Figure(720, 370, 'A block with its shared layer and its ghosts')
    step, left, top = 34, 70, 56

    def at(i):
        return left + step * i

    figure.rect(at(5) - 12, top - 12, 6 * step + 24, 6 * step + 24, fill='#fff7e6', stroke=ORANGE, dash='5 4')
    figure.rect(at(6), top + step, 4 * step, 4 * step, fill='#dbeafe', stroke=BLUE, thickness=2.5)
    for row in range(7):
        for column in range(1, 17):
            own = 6 <= column < 10 and 1 <= row < 5
            shared = not own and 6 <= column <= 10 and 1 <= row <= 5
            ghost = not own and not shared and 5 <= column <= 11
            color = BLUE if own else GREEN if shared else ORANGE if ghost else '#bbb'
            figure.dot(at(column), top + step * row, color, 4 if own or shared or ghost else 2.5)
    figure.text(at(8), top - 26, 'a block of 4 x 4 cells; real ones have 8, 12 or 16 a side', anchor='middle')
    legend = [(BLUE, 'samples that the block owns: the histogram counts them here'),
              (GREEN, 'shared layer: each cell belongs to exactly one block; part of the span'),
              (ORANGE, 'ghosts: for gradients at the vertices; no part of the span'),
              ('#bbb', 'samples of other blocks, which this one does not store')]
    for i, (color, text) in enumerate(legend):
        figure.dot(left, 304 + 17 * i, color)
        figure.text(left + 14, 308 + 17 * i, text)
    return figure.svg()


def column():
    """Draws the proof: depths over one pixel."""
    figure = Figure(720, 230, 'Why culling loses no fragment: depths over one pixel')
    figure.text(20, 78, 'eye')
    figure.arrow(48, 74, 690, 74)
    figure.text(696, 78, 'z')
    figure.rect(400, 58, 240, 32, stroke=ORANGE)
    figure.line(400, 50, 400, 130, stroke=ORANGE, dash='5 4')
    figure.text(520, 110, 'depths that block b can reach', fill=ORANGE, anchor='middle')
    figure.text(400, 148, 'nearest_depth(b), rounded towards the eye', fill=ORANGE, anchor='middle')
    for x, above, below, color in ((190, 'D(p): depth of the composited occluders', 't = D(p): texel of the map', BLUE),
                                   (550, 'd: a fragment of b', '', RED)):
        figure.line(x, 52, x, 96, stroke=color, thickness=2.5)
        figure.dot(x, 74, color)
        figure.text(x, 40, above, fill=color, anchor='middle')
        figure.text(x, 116, below, fill=color, anchor='middle')
    figure.text(20, 196, 'b is culled only if t &lt; nearest_depth(b) at every texel of its footprint. Then')
    figure.text(20, 214, 'D(p) = t &lt; nearest_depth(b) &lt;= d: a fragment that is drawn in any case comes first.')
    return figure.svg()


def mask():
    """Draws the view from above: one bit a pixel hides a block in front of the block that covers its pixels."""
    figure = Figure(720, 290, 'A block in front, which one bit a pixel hides')
    figure.text(14, 154, 'eye')
    for end in (44, 98, 202, 256):
        figure.line(44, 150, 430, 150 + (end - 150) * 0.96, stroke=GREY, thickness=1)
        figure.dot(430, 150 + (end - 150) * 0.96, GREY, 2.5)
    for i in range(5):
        figure.rect(430, 40 + 44 * i, 44, 44, fill='#dbeafe', stroke=BLUE)
    figure.path('M450 40 C 470 90, 436 130, 456 170 S 446 240, 454 260', stroke=BLUE)
    for i, text in enumerate(('Occluding blocks: rays hit four,', 'the middle one is their neighbour.',
                              'Their pixels are covered.')):
        figure.text(488, 56 + 18 * i, text, fill=BLUE)
    figure.rect(250, 134, 32, 32, fill='#fde8e8', stroke=RED)
    figure.path('M260 140 q 12 8 4 20', stroke=RED)
    figure.text(180, 154, 'b: no ray', fill=RED)
    for i, (text, color) in enumerate((('One bit a pixel: all covered.', RED), ('b is culled: it is missing.', RED),
                                       ('Depth a pixel: b may be nearer.', GREEN), ('b is drawn.', GREEN))):
        figure.text(488, 180 + 18 * i, text, fill=color)
    return figure.svg()


class FlatTree:
    """The tree of spans over a square of 16 x 16 blocks with pages of 4 x 4. The field is the distance from a point.

    A node is (x, y, side), in blocks.
    """

    CENTER, ISOVALUE = (-3.0, 19.0), 14
    VOLUME, PAGE, BLOCK = 16, 4, 1
    ACTIVE, ACTIVE_BLOCK, EMPTY, UNSEEN = '#dbeafe', '#93c5fd', '#eee', '#fff'

    def row(self, side):
        """The nodes of a size, the parts of each node beside each other."""
        if side == self.VOLUME:
            return [(0, 0, side)]
        return [(x + dx, y + dy, side) for x, y, _ in self.row(2 * side) for dy in (0, side) for dx in (0, side)]

    def span(self, node):
        """Least and largest distance."""
        ends = [(begin - center, begin + node[2] - center) for begin, center in zip(node, self.CENTER)]
        return (math.hypot(*(max(low, -high, 0) for low, high in ends)),
                math.hypot(*(max(-low, high) for low, high in ends)))

    def is_active(self, node):
        least, most = self.span(node)
        return least < self.ISOVALUE <= most

    def is_reached(self, node):
        """Whether all nodes above are active, so that this one is looked at."""
        x, y, side = node
        above = (x - x % (2 * side), y - y % (2 * side), 2 * side)
        return side == self.VOLUME or (self.is_active(above) and self.is_reached(above))

    def color(self, node):
        return self.UNSEEN if not self.is_reached(node) else self.ACTIVE if self.is_active(node) else self.EMPTY

    def draw_blocks(self, figure, page, left, top, step):
        """Draws the blocks of an active page, its corner at (left, top), those that are active filled."""
        for i in range(self.PAGE**2):
            x, y = i % self.PAGE, i // self.PAGE
            is_active = self.is_active((page[0] + x, page[1] + y, self.BLOCK))
            figure.rect(left + step * x, top + step * y, step, step, self.ACTIVE_BLOCK if is_active else 'none', BLUE,
                        thickness=0.5)


def draw_slice(figure, tree, left, top, step):
    """Draws the blocks as they lie in the volume, as far as they are looked at, and the surface."""
    for side in (8, tree.PAGE):
        for node in filter(tree.is_reached, tree.row(side)):
            x, y = left + step * node[0], top + step * node[1]
            figure.rect(x, y, step * side, step * side, tree.color(node), GREY, thickness=1)
            if side == tree.PAGE and tree.is_active(node):
                tree.draw_blocks(figure, node, x, y, step)
    for x, y, side in tree.row(8):
        figure.rect(left + step * x, top + step * y, step * side, step * side)
    x, y, radius = left + step * tree.CENTER[0], top + step * tree.CENTER[1], step * tree.ISOVALUE
    bottom = top + step * tree.VOLUME
    begin_y, end_x = y - math.sqrt(radius**2 - (x - left)**2), x + math.sqrt(radius**2 - (y - bottom)**2)
    figure.path(f'M{left} {begin_y:.1f} A {radius} {radius} 0 0 1 {end_x:.1f} {bottom}', stroke=RED)


def draw_tree(figure, tree, middle):
    """Draws the nodes in rows, and the blocks of active pages below them."""
    rows = [(tree.VOLUME, 76, 0, 'volume'), (8, 136, 80, 'nodes'), (tree.PAGE, 196, 20, 'pages')]

    def place(side, step, i):
        return middle + step * (i - (len(tree.row(side)) - 1) / 2)

    for (above, y1, wide, _), (below, y2, step, _) in zip(rows, rows[1:]):
        for i, node in enumerate(tree.row(below)):
            if tree.is_reached(node):
                figure.line(place(above, wide, i // 4), y1 + 8, place(below, step, i), y2 - 8, stroke=GREY, thickness=1)
    for side, y, step, name in rows:
        figure.text(316, y + 4, name, fill='#666', anchor='end', size=11)
        for i, node in enumerate(tree.row(side)):
            x, color, is_seen = place(side, step, i), tree.color(node), tree.is_reached(node)
            ink = BLUE if color == tree.ACTIVE else '#666'
            figure.rect(x - 8, y - 8, 16, 16, color, ink, dash='' if is_seen else '3 3')
            if side != tree.PAGE:
                least, most = tree.span(node)
                figure.text(x + 12, y + 4, f'{least:.0f} to {most:.0f}', fill=ink, size=11)
            elif color == tree.ACTIVE:
                figure.line(x, y + 8, x, 242, stroke=GREY, thickness=1)
                tree.draw_blocks(figure, node, x - 8, 242, 4)
    figure.text(316, 254, 'blocks', fill='#666', anchor='end', size=11)


def octree():
    """The octree of spans: what an isovalue looks at, and what it leaves out."""
    figure = Figure(720, 388, 'The octree of spans: what an isovalue looks at, and what it leaves out')
    tree = FlatTree()
    figure.text(20, 24, 'a slice through the volume')
    draw_slice(figure, tree, 20, 56, 15)
    figure.text(340, 24, f'the tree: does a span hold the isovalue {tree.ISOVALUE}?')
    draw_tree(figure, tree, 492)
    for color, begin, end, y, text in ((GREEN, 56, 208, 290, 'two samples a node: every agent holds them'),
                                       (ORANGE, 236, 264, 308, 'two samples a block: loaded page by page')):
        figure.line(326, begin, 326, end, stroke=color, thickness=2.5)
        figure.line(340, y, 352, y, stroke=color, thickness=2.5)
        figure.text(360, y + 4, text)
    for x, fill, stroke, dash, text in ((20, tree.ACTIVE, BLUE, '', 'holds it: looked into'),
                                        (192, tree.ACTIVE_BLOCK, BLUE, '', 'active block'),
                                        (316, tree.EMPTY, '#666', '', 'does not: left out with all below'),
                                        (572, tree.UNSEEN, '#666', '3 3', 'not looked at')):
        figure.rect(x, 332, 14, 14, fill, stroke, dash)
        figure.text(x + 22, 344, text)
    figure.text(20, 374, 'Drawn flat, with pages of 4 x 4 blocks. Real ones have 16 x 16 x 16; nodes above have eight parts.',
                fill='#666', size=11)
    return figure.svg()


FIGURES = {'block.svg': block, 'column.svg': column, 'mask.svg': mask, 'octree.svg': octree}


def main():
    if sys.argv[1:] not in ([], ['--check']):
        print(__doc__, file=sys.stderr)
        return 2
    if sys.argv[1:]:
        old = [name for name, draw in FIGURES.items() if (FOLDER / name).read_text() != draw()]
        for name in old:
            print(f'{name} is not what tools/draw_algorithm.py draws: run it', file=sys.stderr)
        return 1 if old else 0
    for name, draw in FIGURES.items():
        (FOLDER / name).write_text(draw())
    return 0


if __name__ == '__main__':
    sys.exit(main())
