"""The parts of `isoscope.serve`: the programs that it starts, and the files that it writes for them."""
