import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.models.amplitude_model import Band, Memory

NOT_SHOWN = {"radar_1.fields.amplitude": "", "radar_2.fields.amplitude": ""}


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        ({"engine": "gaussian"}, Memory),
        ({"engine": "gaussian", "amplitude": "band"}, Band),
        ({"engine": "gaussian", **NOT_SHOWN}, Band),
        ({"engine": "particles"}, Band),
        ({"engine": "phd"}, Band),
        ({"engine": "phd", "amplitude": "memory"}, Memory),
    ],
)
def test_amplitude_auto_remembers_snrs_where_classes_of_gaussians_depend_on_them(given, kind):
    assert type(resolve(given).model.amplitudes) is kind


def test_amplitude_auto_of_one_class_has_no_snr_to_remember():
    given = {"engine": "gaussian", "classes": ["class_0"]}
    births = {f"start_{n}.rates": [0.01] for n in (1, 2, 3, 4)}
    assert type(resolve({**given, **births}).model.amplitudes) is Band
