"""Materials: laws of energy, physics that bounds the table, and sources that say what they are."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyroomacoustics.parameters import materials_absorption_table

from elfslam.base.errors import InputError
from elfslam.world import materials

SHARE = st.floats(0.0, 1.0)


@given(absorption=SHARE, scattering=SHARE, frequency_hz=st.floats(15_000.0, 20_000.0))
def test_no_energy_is_lost_or_made_at_any_frequency(
    absorption: float, scattering: float, frequency_hz: float
) -> None:
    made = materials.Material("any", absorption, scattering, "test")
    for there in (made, made.at(frequency_hz)):
        assert there.reflection**2 + there.diffuse + there.absorption == pytest.approx(1.0)


@pytest.mark.parametrize("roughness_m", [1e-4, 3e-4, 1e-3, 2e-3])
def test_a_rough_wall_mirrors_by_its_height_in_wavelengths(roughness_m: float) -> None:
    """Rayleigh's roughness: exp(-(4 pi height cos / wavelength)^2), at 45 degrees and any
    frequency."""
    wall = materials.Material("rough", 0.0, materials.rough_scattering(roughness_m), "test")
    for frequency_hz in (15_000.0, 17_500.0, 20_000.0):
        wavelength_m = 343.0 / frequency_hz
        mirrored = np.exp(-((4 * np.pi * roughness_m * np.cos(np.pi / 4) / wavelength_m) ** 2))
        assert wall.at(frequency_hz).reflection ** 2 == pytest.approx(mirrored)


@given(absorption=st.floats(0.0, 0.85), scattering=st.floats(0.001, 0.95))
def test_falls_are_slopes_of_what_the_material_says(absorption: float, scattering: float) -> None:
    """Of pressures, by the logarithm of the frequency about 17.5 kHz; energy is kept in them."""
    made, step = materials.Material("any", absorption, scattering, "test"), 1e-5
    low, high = (made.at(materials.MIDDLE_HZ * np.exp(sign * step)) for sign in (-1, 1))
    mirrored = np.log(low.reflection / high.reflection) / (2 * step)
    diffuse = np.log(low.diffuse / high.diffuse) / (4 * step)
    assert made.mirror_fall == pytest.approx(mirrored, rel=1e-3, abs=1e-6)
    assert made.diffuse_fall == pytest.approx(diffuse, rel=1e-3, abs=1e-4)
    absorbed = (high.absorption - low.absorption) / (2 * step)
    lost = 2 * (made.mirror_fall * made.reflection**2 + made.diffuse_fall * made.diffuse)
    assert lost == pytest.approx(absorbed, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize(("absorption", "scattering"), [(-0.1, 0.0), (1.1, 0.0), (0.5, 2.0)])
def test_shares_beyond_one_are_refused(absorption: float, scattering: float) -> None:
    with pytest.raises(InputError, match=r"material 'odd': wanted \w+ from 0 to 1, got"):
        materials.Material("odd", absorption, scattering, "test")


def test_an_unknown_name_gets_the_near_one() -> None:
    with pytest.raises(InputError, match=r"material 'carpit': .*did you mean 'carpet'\?"):
        materials.material("carpit")
    with pytest.raises(InputError, match=r"material 'xyz': .*choose one of them"):
        materials.material("xyz")


def test_nothing_absorbs_less_than_the_air_at_a_rigid_wall() -> None:
    """Random incidence on the layers in which the sound shears the air and warms the wall.

    Admittance k/2 (d_v sin^2 + 0.4 d_t); absorption is 4 of it over the cosine, averaged over
    sin 2a.
    """
    angle = np.linspace(0.0, np.pi / 2, 10_001)[:-1]
    angular_hz = 2 * np.pi * 17_500.0
    shear_m = np.sqrt(2 * 1.5e-5 / angular_hz)
    heat_m = shear_m / np.sqrt(0.71)
    admittance = angular_hz / 343.0 / 2 * (shear_m * np.sin(angle) ** 2 + 0.4 * heat_m)
    law = 4 * admittance * np.cos(angle) / (np.cos(angle) + admittance) ** 2
    expected = np.trapezoid(law * np.sin(2 * angle), angle)
    assert pytest.approx(expected, abs=1.5e-3) == materials.BOUNDARY_LAYER_ABSORPTION
    least = min(item.absorption for item in materials.MATERIALS.values())
    assert least == materials.BOUNDARY_LAYER_ABSORPTION


def test_scattering_of_the_rough_is_that_of_the_roughness_stated() -> None:
    stated = {
        item.name: float(found[1])
        for item in materials.MATERIALS.values()
        if (found := re.search(r"roughness of ([\d.]+) mm", item.source))
    }
    assert len(stated) > 10
    for name, roughness_mm in stated.items():
        assert materials.material(name).scattering == pytest.approx(
            materials.rough_scattering(roughness_mm / 1000), abs=6e-4
        )


PUBLISHED = {
    "concrete": "unpainted_concrete",
    "brick": "brick_wall_rough",
    "gypsum board": "plasterboard",
    "wood panel": "wooden_lining",
    "door": "wooden_door",
    "wood floor": "stage_floor",
    "carpet": "carpet_6mm_closed_cell_foam",
    "thick carpet": "carpet_tufted_9m",
    "curtain": "curtains_cotton_0.5",
    "acoustic ceiling tile": "fibre_absorber_1",
    "acoustic partition": "panel_fabric_covered_8pcf",
    "fabric partition": "felt_5mm",
    "sofa": "chairs_heavy_upholstered",
    "office chair": "chairs_upholstered_cloth",
    "person": "audience_wooden_chairs_1_m2",
}


@pytest.mark.parametrize(("name", "row"), PUBLISHED.items())
def test_measured_values_are_the_last_of_the_published_row(name: str, row: str) -> None:
    coefficients = materials_absorption_table[row]["coeffs"]
    band_khz = {7: 8, 6: 4}[len(coefficients)]
    assert materials.material(name).absorption == coefficients[-1]
    assert f"absorption: {band_khz} kHz band" in materials.material(name).source
