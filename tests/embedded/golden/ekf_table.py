"""A textbook extended Kalman filter on a pendulum as a C header: what dse/ekf.h has to reproduce.

    ekf_table.py OUTPUT.h

Written apart from the library, in the plain covariance form, from the equations

    x+ = f(x),  P+ = F P F' + Q
    S = H P H' + R,  K = P H' / S,  x = x + K (y - h),  P = (I - K H) P

    angle+ = angle + h speed,   speed+ = speed - h (g/l sin(angle) + d speed),   y = l sin(angle)
"""

import math
import random
import sys
from pathlib import Path

STEP, GRAVITY, LENGTH, DAMPING = 0.02, 9.81, 0.5, 0.1
NOISE = ((1e-6, 0.0), (0.0, 1e-4))
R = 4e-4
SAMPLES = 150
MISSING_EVERY = 7  # a sample that does not come: the filter only predicts

Vector = tuple[float, float]
Matrix = tuple[Vector, Vector]


def matrix(rows: list[list[float]]) -> Matrix:
    """Two rows of two."""
    (a, b), (c, d) = rows
    return (a, b), (c, d)


def move(x: Vector) -> Vector:
    """One step of the pendulum."""
    angle, speed = x
    pull = GRAVITY / LENGTH * math.sin(angle) + DAMPING * speed
    return angle + STEP * speed, speed - STEP * pull


def predict(x: Vector, p: Matrix) -> tuple[Vector, Matrix]:
    """Time update."""
    f = ((1.0, STEP), (-STEP * GRAVITY / LENGTH * math.cos(x[0]), 1.0 - STEP * DAMPING))
    fp = [[sum(f[i][k] * p[k][j] for k in range(2)) for j in range(2)] for i in range(2)]
    fpf = [[sum(fp[i][k] * f[j][k] for k in range(2)) for j in range(2)] for i in range(2)]
    grown = [[fpf[i][j] + NOISE[i][j] for j in range(2)] for i in range(2)]
    return move(x), matrix(grown)


def update(x: Vector, p: Matrix, y: float) -> tuple[Vector, Matrix]:
    """Measurement update."""
    slope = LENGTH * math.cos(x[0])
    s = slope * p[0][0] * slope + R
    gain = (p[0][0] * slope / s, p[1][0] * slope / s)
    e = y - LENGTH * math.sin(x[0])
    shrunk = [[p[i][j] - gain[i] * slope * p[0][j] for j in range(2)] for i in range(2)]
    return (x[0] + gain[0] * e, x[1] + gain[1] * e), matrix(shrunk)


def main() -> None:
    """Simulate, filter, write."""
    source = random.Random(1960)
    truth, x, p = (1.2, 0.0), (0.8, 0.5), ((0.25, 0.0), (0.0, 1.0))
    start = x
    measured, expected = [], []
    for k in range(SAMPLES):
        truth = move(truth)
        y = LENGTH * math.sin(truth[0]) + source.gauss(0.0, math.sqrt(R))
        missing = k % MISSING_EVERY == MISSING_EVERY - 1
        x, p = predict(x, p)
        if not missing:
            x, p = update(x, p, y)
        measured.append("DSE_REAL(NAN)" if missing else f"DSE_REAL({y.hex()})")
        row = (*x, p[0][0], p[1][0], p[1][1])
        expected.append("{" + ", ".join(f"DSE_REAL({v.hex()})" for v in row) + "},")
    constants = {
        "STEP": STEP, "GRAVITY": GRAVITY, "LENGTH": LENGTH, "DAMPING": DAMPING, "R": R,
        "Q_ANGLE": NOISE[0][0], "Q_SPEED": NOISE[1][1],
        "ANGLE": start[0], "SPEED": start[1],
    }  # fmt: skip
    lines = [
        "/* Made by ekf_table.py. */",
        "#include <math.h>",
        '#include "dse/real.h"',
        f"#define PENDULUM_SAMPLES {SAMPLES}",
        *(f"#define PENDULUM_{k} DSE_REAL({v.hex()})" for k, v in constants.items()),
        f"static const dse_real pendulum_y[] = {{{', '.join(measured)}}};",
        "/* angle, speed, P11, P21, P22 after each sample */",
        "static const dse_real pendulum_expected[][5] = {",
        *expected,
        "};",
    ]
    Path(sys.argv[1]).write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
