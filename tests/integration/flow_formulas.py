"""The fields of `isoscope generate flow`, by the formulas of its --help."""

import math


def fluid(position, t):
    """Pressure, temperature and velocity by the formulas of --help."""
    def sin(value):
        return math.sin(4 * math.pi * value)

    def cos(value):
        return math.cos(4 * math.pi * value)

    def g(q, h):
        square = h * h + 0.0002 * t
        return h / math.sqrt(square) * math.exp(-q * q / (2 * square))

    x = position[0] + 0.08 - 0.03 * t
    y = position[1] + 0.05 - 0.02 * t
    z = position[2] + 0.12 - 0.05 * t
    speed = 0.1 * math.exp(-0.4 * t)
    v = (speed * (sin(z) + 0.6 * cos(y)), speed * (0.8 * sin(x) + cos(z)),
         speed * (0.6 * sin(y) + 0.8 * cos(x)))
    s = (1 - math.exp(-0.4 * t)) / 8
    for _ in range(2):
        x -= s * (sin(z) + 0.6 * cos(y))
        y -= s * (0.8 * sin(x) + cos(z))
        z -= s * (0.6 * sin(y) + 0.8 * cos(x))
    temperature = 293.15 + 60 * g(x, 0.1) * g(y, 0.1) * g(z, 0.2)
    return -500 * sum(c * c for c in v), temperature, (0.03 + v[0], 0.02 + v[1], 0.05 + v[2])
