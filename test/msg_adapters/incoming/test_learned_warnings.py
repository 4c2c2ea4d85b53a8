import pytest

from msg_adapters.incoming import anomalies

NAME = "detection_probability"


def detection(found, std=0.02):
    return {NAME: found, f"{NAME}_std": std, f"{NAME}_set": 0.9}


def noise(ratio, std=0.02):
    return {"range_noise_ratio": ratio, "range_noise_ratio_std": std}


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        (detection(0.5), "it detects targets with probability 0.50 instead of 0.90"),
        (noise(2.0), "its range noise is 2 times the configured one"),
    ],
)
def test_radar_that_is_worse_than_set_gives_a_warning_with_the_numbers(figures, said):
    assert said in anomalies.of_learned(figures)


@pytest.mark.parametrize(
    "figures",
    [{}, detection(0.85), detection(0.5, std=0.2), noise(1.2), noise(0.5), noise(2.0, std=0.5)],
)
def test_radar_that_is_as_set_or_not_known_well_gives_none(figures):
    assert anomalies.of_learned(figures) is None


@pytest.mark.parametrize("figures", [detection(0.72), detection(0.5, std=0.2), noise(1.4)])
def test_warning_stays_until_the_radar_is_clearly_better(figures):
    assert anomalies.of_learned(figures) is None
    assert anomalies.of_learned(figures, warned=True) is not None


@pytest.mark.parametrize("figures", [{}, detection(0.8), noise(1.2)])
def test_warning_ends_when_the_radar_is_clearly_better(figures):
    assert anomalies.of_learned(figures, warned=True) is None


def test_figures_of_a_radar_are_not_those_of_others():
    figures = {"radar.range_noisier": 1.0, "radar_2.range_noisier": 2.0, "hypotheses": 3.0}
    assert anomalies.figures_of("radar", figures) == {"range_noisier": 1.0}


def test_an_anomaly_that_only_its_decoder_knows_is_named():
    assert list(anomalies.of(None, {"positions_implausible": 3})) == ["3 positions implausible"]
