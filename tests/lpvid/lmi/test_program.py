"""Programs whose goal is a ratio, against grids."""

import numpy as np
import pytest

from lpvid.lmi.affine import block
from lpvid.lmi.program import Program


def test_ratio_against_a_grid():
    """Largest (x − 1)/(x² + 1) over 1 ≤ x ≤ 4, the square as a second unknown: x = 1 + √2."""
    program = Program()
    x, square = program.unknowns.scalar(), program.unknowns.scalar()
    program.require(block([[square, x], [x, np.eye(1)]]))  # square ≥ x²
    program.require(x - 1.0)
    program.require(4.0 - x)
    for limit in (1.0, 1e3):
        program.maximise_ratio(x - 1.0, square + 1.0, limit)
        found = next(program.solve())
        grid = np.linspace(1, 4, 30001)
        assert found.objective == pytest.approx(((grid - 1) / (grid**2 + 1)).max(), rel=1e-5)
        assert found[x][0, 0] == pytest.approx(1 + np.sqrt(2), rel=1e-2)
    program.require(1.0 - x)  # nothing above zero is left
    program.maximise_ratio(x - 1.0, square + 1.0)
    assert all(abs(answer.objective) < 1e-6 for answer in program.solve())
