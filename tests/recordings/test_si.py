"""Units against a library of physical constants, and against each other."""

import numpy as np
import pytest
from scipy import constants
from slapshot.recordings.si import check_si, to_si


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("rad", "rad", 1.0),
        ("deg", "rad", constants.degree),
        ("°", "rad", constants.degree),
        ("turns", "rad", 2 * constants.pi),
        ("rpm", "rad/s", 2 * constants.pi / constants.minute),
        ("deg/s", "rad/s", constants.degree),
        ("in", "m", constants.inch),
        ("ft", "m", constants.foot),
        ("km/h", "m/s", constants.kmh),
        ("lbf", "N", constants.lbf),
        ("kgf", "N", constants.kgf),
        ("lbf ft", "N m", constants.lbf * constants.foot),
        ("lbf in", "N m", constants.lbf * constants.inch),
        ("ozf in", "N m", constants.oz * constants.g * constants.inch),
        ("kgf cm", "N m", constants.kgf * constants.centi),
        ("mNm", "N m", 1e-3),
        ("mN m", "N m", 1e-3),
        ("N*m", "N m", 1.0),
        ("N·m", "N m", 1.0),
        ("Nmm", "N m", 1e-3),
        ("μm", "m", 1e-6),
        ("ms", "s", 1e-3),
        ("us", "s", 1e-6),
        ("ns", "s", 1e-9),
        ("%", "1", 0.01),
    ],
)
def test_units_are_those_of_physics(unit: str, si: str, factor: float) -> None:
    assert to_si(unit).unit == si
    np.testing.assert_allclose(to_si(unit).factor, factor, rtol=1e-12)


@pytest.mark.parametrize("unit", ["furlong", "", "M", "Rad", "MNm", "rad / s / s"])
def test_what_is_not_known_or_in_doubt_is_refused(unit: str) -> None:
    with pytest.raises(ValueError, match="is no unit that is known; write one of: rad, "):
        to_si(unit)


def test_a_unit_that_is_allowed_passes() -> None:
    check_si("N m", ("N m",), "torque")
    with pytest.raises(ValueError, match=r"^'mm' is not SI; multiply the values by 0\.001 and write 'm'$"):
        check_si("mm", ("rad", "m"), "position")
