"""Parameter files, in the format that comes with the robots."""

from __future__ import annotations

import math

import pytest

from somrs.adapters.arcos.parameters import TYPES, Parameters, read_parameters
from somrs.errors import UsageError

FILE = """
;; Robot parameter file
Section Conversion factors
AngleConvFactor 0.00153  ; radians per angular unit (2PI/4096)
DistConvFactor 0.48500   ; multiplier to mm from robot units
VelConvFactor 1.00000
RangeConvFactor 0.268
RobotWidth 425.00000    ; width in mm
Section Sonar parameters
SonarNum 2
SonarUnit 0 69 136 90
SonarUnit 1 114 119 50 0 0 0
"""


def test_a_file_has_factors_and_sonar() -> None:
    parameters = read_parameters(FILE, Parameters())
    assert parameters.metres == pytest.approx(0.000485)
    assert parameters.range_metres == pytest.approx(0.000268)
    assert parameters.half_width == 0.2125
    assert [(disc.x, disc.y) for disc in parameters.sonar] == [(0.069, 0.136), (0.114, 0.119)]


def test_the_angle_is_exact_although_the_file_rounds_it() -> None:
    assert read_parameters(FILE, Parameters()).radians == 2 * math.pi / 4096
    assert read_parameters("AngleConvFactor 0.0174533", Parameters()).radians == 0.0174533


def test_what_a_file_does_not_have_stays() -> None:
    assert read_parameters("", TYPES["p3dx"]) == TYPES["p3dx"]


def test_a_factor_of_zero_is_refused() -> None:
    with pytest.raises(UsageError, match="parameter file"):
        read_parameters("DistConvFactor 0", Parameters())
